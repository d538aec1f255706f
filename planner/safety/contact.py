"""Contact tests: where the body meets a blocked cell on a plan, and manoeuvres without contact."""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.body import meets
from foresee.mapping.kernels import njit
from planner.motion.dynamics import pose_along, rollout


@njit(cache=True, nogil=True)
def first_meeting(  # type: ignore[no-untyped-def]
    states, controls, dt, spacing, blocked, resolution, origin, half_length, half_width
):
    """Find where and how fast the body first meets a blocked cell on a plan.

    The body is tested at the poses that `planner.motion.dynamics.swept` returns.

    Args:
        states: x, y, yaw, v of the plan, (N+1, 4).
        controls: a, κ of the plan, (N, 2).
        dt: step of the plan [s].
        spacing: largest distance between tested poses [m].
        blocked: cells that the body must not meet, (rows, columns); outside, all are blocked.
        resolution: side of a cell [m].
        origin: x, y of the cells' lower-left corner [m].
        half_length: half the body's length [m].
        half_width: half the body's width [m].

    Returns:
        Distance along the plan [m] and speed [m/s] at the first contact; both are -1 without one.
    """
    x, y, yaw = states[0, 0], states[0, 1], states[0, 2]
    if meets(blocked, resolution, origin, x, y, yaw, half_length, half_width):
        return 0.0, states[0, 3]
    along = 0.0
    for k in range(controls.shape[0]):
        a, kappa, v = controls[k, 0], controls[k, 1], states[k, 3]
        s = v * dt + 0.5 * a * dt * dt
        if s <= 1e-6:
            continue
        x, y, yaw = states[k, 0], states[k, 1], states[k, 2]
        count = math.ceil(s / spacing)
        for j in range(1, count + 1):
            part = s * j / count
            px, py, turned = pose_along(x, y, yaw, kappa, part)
            if meets(blocked, resolution, origin, px, py, turned, half_length, half_width):
                return along + part, math.sqrt(max(v * v + 2.0 * a * part, 0.0))
        along += s
    return -1.0, -1.0


@njit(cache=True, nogil=True)
def leads_on(pose, curvatures, length, spacing, place):  # type: ignore[no-untyped-def]
    """Return whether the body meets no blocked cell on at least one of several arcs from a pose.

    Args:
        pose: x, y, yaw at which the arcs begin; further entries are ignored.
        curvatures: curvatures of the arcs, (n,) [1/m].
        length: length of each arc [m].
        spacing: largest distance between tested poses [m].
        place: last five arguments of `first_meeting`: the blocked cells and the body.
    """
    count = math.ceil(length / spacing)
    for i in range(curvatures.shape[0]):
        free = True
        for j in range(1, count + 1):
            x, y, yaw = pose_along(pose[0], pose[1], pose[2], curvatures[i], length * j / count)
            if meets(place[0], place[1], place[2], x, y, yaw, place[3], place[4]):
                free = False
                break
        if free:
            return True
    return False


@njit(cache=True, nogil=True)
def first_free(state, first, ways, driving, spacing, place, onward, arcs):  # type: ignore[no-untyped-def]
    """Return the index of the first manoeuvre that stops the car without a contact, or -1.

    Args:
        state: x, y, yaw, v of the car, (4,).
        first: a, κ of the first step, which replaces that of each manoeuvre, (2,).
        ways: controls of the manoeuvres, (n, N, 2).
        driving: arguments of `rollout` after the controls: step [s] and limits of the car.
        spacing: largest distance between tested poses [m].
        place: last five arguments of `first_meeting`: the blocked cells and the body.
        onward: whether the car must be able to go on from the end of the manoeuvre.
        arcs: arguments of `leads_on` after the pose.
    """
    for i in range(ways.shape[0]):
        controls = ways[i].copy()
        controls[0] = first
        states, applied = rollout(state, controls, *driving)
        # Most manoeuvres fail, and most of these already fail at few poses.
        if (
            states[-1, 3] > 1e-6
            or first_meeting(states, applied, driving[0], 5.0 * spacing, *place)[0] >= 0.0
        ):
            continue
        if first_meeting(states, applied, driving[0], spacing, *place)[0] >= 0.0:
            continue
        if not onward or leads_on(states[-1], *arcs):
            return i
    return -1


def swerves(stages: int, braking: float, tightest: float) -> np.ndarray:
    """Return manoeuvres that brake: along a plan, on one arc, or on two of these in succession.

    Args:
        stages: number of steps of each manoeuvre.
        braking: deceleration in all steps [m/s²].
        tightest: curvature of the tightest arc, of which the others have shares [1/m].

    Returns:
        Controls a, κ of the manoeuvres, (n, stages, 2); a NaN stands for the plan's own curvature.
    """
    shares = (-1.0, -0.5, 0.0, 0.5, 1.0)
    made = [(share, share, 0) for share in (math.nan, *np.linspace(-1.0, 1.0, 13))]
    made += [
        (one, two, after)
        for after in (4, 8, 12)
        for one in (math.nan, *shares)
        for two in shares
        if one != two
    ]
    ways = np.empty((len(made), stages, 2))
    ways[:, :, 0] = -braking
    for way, (one, two, after) in zip(ways, made, strict=True):
        way[:after, 1], way[after:, 1] = one * tightest, two * tightest
    return ways
