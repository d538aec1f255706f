"""Where a body on its way first meets something, and ways on which it meets nothing."""

from __future__ import annotations

import math

import numpy as np

from planner.motion.dynamics import pose_along, rollout
from predictor.mapping.body import meets
from predictor.mapping.kernels import njit


@njit(cache=True, nogil=True)
def first_meeting(  # type: ignore[no-untyped-def]
    states, controls, dt, spacing, blocked, resolution, origin, half_length, half_width
):
    """Return the distance along a plan [m] and the speed [m/s] at which the body first meets a
    blocked cell.

    Both are -1 if it meets none. The body is tested at poses at most `spacing` [m] apart, as
    `planner.motion.dynamics.swept` spaces them, the first state's among them.
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
    """Return whether some arc from a pose (x, y, yaw) meets nothing.

    Args:
        pose: where the arcs begin; what follows yaw is not looked at.
        curvatures: of the arcs [1/m].
        length: of each [m].
        spacing: between tested poses [m].
        place: blocked cells, resolution, origin and the body's halves, as `first_meeting` has them.
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
    """Return the number of the first way that ends at rest and meets nothing blocked, or -1.

    Args:
        state: x, y, yaw, v now, (4,).
        first: a, κ of the first step, in place of each way's own, (2,).
        ways: controls, (n, N, 2).
        driving: what `rollout` is told of the car: its step [s], and its limits.
        spacing: between tested poses [m].
        place: blocked cells, resolution, origin and the body's halves, as `first_meeting` has them.
        onward: whether a way must lead on from its end.
        arcs: what `leads_on` is told besides the pose.
    """
    for i in range(ways.shape[0]):
        controls = ways[i].copy()
        controls[0] = first
        states, applied = rollout(state, controls, *driving)
        # Most ways fail, and few poses tell.
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
    """Return ways to brake: along a plan, on one arc, and on one of these after another.

    Args:
        stages: steps of each.
        braking: held on all of them [m/s²].
        tightest: curvature [1/m] of which the arcs have shares.

    Returns:
        Controls (n, stages, 2); where a curvature is NaN, the plan's own is meant.
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
