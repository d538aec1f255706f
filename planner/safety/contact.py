"""Contact tests: where the body meets a blocked cell on a plan, and manoeuvres without contact."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Scene, meets
from foresee.mapping.kernels import njit
from planner.motion.dynamics import pose_along, rollout
from planner.safety.course import rejoins
from planner.safety.tube import LEAST, carried_out, grown, overshoot, widened

CONTACT_SPACING = 0.02
"""Largest distance between the poses at which a plan is tested [m]."""
ANYWHERE, ONWARD, ON_COURSE = 0, 1, 2
"""Where a manoeuvre must end: anywhere; where the car can go on along some arc; where it can follow
its course."""


class Arcs(NamedTuple):
    """Arcs on which a car may go on, as `leads_on` reads them.

    Attributes:
        curvatures: curvatures of the arcs, (n,) [1/m].
        length: length of each arc [m].
        spacing: largest distance between tested poses [m].
        scene: cells that the body must not meet on them, and the body.
    """

    curvatures: NDArray[np.float64]
    length: float
    spacing: float
    scene: Scene


@njit(cache=True, nogil=True)
def plan_contact(states, controls, dt, spacing, scene, tube):  # type: ignore[no-untyped-def]
    """Find where and how fast the body first meets a blocked cell on a plan.

    The body is tested at the poses that `planner.motion.dynamics.swept` returns, grown by the
    radius of the plan's tube. With a lag, these are poses of the plan as the car carries it out.

    Args:
        states: x, y, yaw, v of the plan, (N+1, 4).
        controls: a, κ of the plan, (N, 2).
        dt: step of the plan [s].
        spacing: largest distance between tested poses [m].
        scene: obstacles and body.
        tube: `Tube` of the plan.

    Returns:
        Distance along the plan [m] and speed [m/s] at the first contact; both are -1 without one.
    """
    states, controls, commands, dt = carried_out(tube, states, controls, dt)
    radius, off, slip, speed = tube.radius, tube.yaw, tube.slip, tube.speed
    if meets(grown(scene, radius, radius), states[0, 0], states[0, 1], states[0, 2]):
        return 0.0, states[0, 3]
    along, before, curvature, bent = 0.0, tube.acceleration, tube.curvature, tube.response[1]
    for k in range(controls.shape[0]):
        a, kappa, v = controls[k, 0], controls[k, 1], states[k, 3]
        s = v * dt + 0.5 * a * dt * dt
        if s <= LEAST:
            continue
        change, bend = abs(commands[k, 0] - before), abs(commands[k, 1] - curvature)
        turn = abs(kappa - bent)
        radius, off, slip, speed = widened(
            tube, radius, off, slip, speed, v, change, bend, turn, s, dt
        )
        before, curvature, bent = commands[k, 0], commands[k, 1], kappa
        x, y, yaw = states[k, 0], states[k, 1], states[k, 2]
        count = math.ceil(s / spacing)
        around = grown(scene, radius, radius)
        for j in range(1, count + 1):
            part = s * j / count
            px, py, turned = pose_along(x, y, yaw, kappa, part)
            if meets(around, px, py, turned):
                return along + part, math.sqrt(max(v * v + 2.0 * a * part, 0.0))
        along += s
    beyond, last = overshoot(tube, slip, speed), states[-1]
    if tube.lag > 0.0 and last[3] > LEAST:
        return along, last[3]
    if beyond > 0.0:
        # In a curve, the car also moves sideways while it goes on beyond the end.
        aside = radius + abs(bent) * beyond * (tube.reach + 0.5 * beyond)
        if meets(grown(scene, radius + beyond, aside), last[0], last[1], last[2]):
            return along, 0.0
    return -1.0, -1.0


@njit(cache=True, nogil=True)
def _meets_at_states(states, scene):  # type: ignore[no-untyped-def]
    """Return whether the body meets a blocked cell at one of the states, tested from the last."""
    for k in range(states.shape[0] - 1, -1, -1):
        # At rest, the same pose is not tested again.
        if k > 0 and states[k - 1, 3] == 0.0 and states[k, 3] == 0.0:
            continue
        if meets(scene, states[k, 0], states[k, 1], states[k, 2]):
            return True
    return False


@njit(cache=True, nogil=True)
def leads_on(pose, arcs):  # type: ignore[no-untyped-def]
    """Return whether the body meets no blocked cell on at least one of several arcs from a pose.

    Args:
        pose: x, y, yaw at which the arcs begin; further entries are ignored.
        arcs: `Arcs` to test.
    """
    count = math.ceil(arcs.length / arcs.spacing)
    for curvature in arcs.curvatures:
        free = True
        for j in range(1, count + 1):
            part = arcs.length * j / count
            x, y, yaw = pose_along(pose[0], pose[1], pose[2], curvature, part)
            if meets(arcs.scene, x, y, yaw):
                free = False
                break
        if free:
            return True
    return False


@njit(cache=True, nogil=True)
def first_free(  # type: ignore[no-untyped-def]
    state, manoeuvres, dt, limits, spacing, scene, tube, end, arcs, course
):
    """Return the index of the first manoeuvre that stops the car without a contact, or -1.

    Args:
        state: x, y, yaw, v of the car, (4,).
        manoeuvres: controls of the manoeuvres, (n, N, 2).
        dt: length of a step [s].
        limits: the car's `DrivingLimits`.
        spacing: largest distance between tested poses [m].
        scene: obstacles and body.
        tube: `Tube` of the manoeuvres.
        end: where the manoeuvre must end: `ANYWHERE`, `ONWARD` or `ON_COURSE`.
        arcs: `Arcs` on which the car may go on.
        course: `Course` that it may follow.
    """
    around = grown(scene, tube.radius, tube.radius)
    for i in range(manoeuvres.shape[0]):
        states, controls = rollout(state, manoeuvres[i], dt, limits)
        if states[-1, 3] > 1e-6:
            continue
        # The cheapest tests come first: most manoeuvres fail, and most of these at their end.
        if _meets_at_states(states, around):
            continue
        if end == ONWARD and not leads_on(states[-1], arcs):
            continue
        if end == ON_COURSE and not rejoins(states[-1], course):
            continue
        if plan_contact(states, controls, dt, spacing, scene, tube)[0] < 0.0:
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
        (first, second, after)
        for after in (4, 8, 12)
        for first in (math.nan, *shares)
        for second in shares
        if first != second
    ]
    manoeuvres = np.empty((len(made), stages, 2))
    manoeuvres[:, :, 0] = -braking
    for manoeuvre, (first, second, after) in zip(manoeuvres, made, strict=True):
        manoeuvre[:after, 1], manoeuvre[after:, 1] = first * tightest, second * tightest
    return manoeuvres
