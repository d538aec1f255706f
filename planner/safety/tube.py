"""The tube of a plan: how far the body may be from where the plan has it.

The pose at which a plan starts is an estimate, and its controls act a little earlier or later than
planned, and with a lag. The tube bounds what that adds up to, step by step. A plan is safe if the
body, grown by the tube's radius, is: docs/explanation/safety.md derives the terms.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from foresee.mapping.body import Scene
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import TIGHTEST
from foresee.mapping.error_bounds import ErrorBounds
from foresee.mapping.kernels import njit

TRANSIENT = 0.368
"""Largest difference between the integrals of a first-order lag's step response and of a step that
is delayed by its time constant, divided by that time: 1/e."""

LEAST = 1e-6
"""Length of a step below which the car counts as standing [m]."""
AHEAD = 2.0
"""Distance ahead whose tube paths and plans keep away from obstacles [m]."""


class Tube(NamedTuple):
    """How far the body may be from a plan's start, and how errors grow along the plan.

    Attributes:
        radius: distance of the body from the place at which the plan starts, at most [m].
        yaw: difference of the yaw there, at most [rad].
        slip: distance along the plan by which the car may be ahead or behind, at most [m].
        speed: difference of the speed, at most [m/s].
        half: time by which a control may act earlier or later than planned, at most [s].
        lag: time constant of the response to a control, of which the plan includes a delay [s].
        reach: half diagonal of the body [m].
        braking: hardest braking [m/s²].
        acceleration: acceleration of the last control before the plan [m/s²].
        curvature: its curvature [1/m].
    """

    radius: float
    yaw: float
    slip: float
    speed: float
    half: float
    lag: float
    reach: float
    braking: float
    acceleration: float
    curvature: float


EXACT = Tube(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""The tube of a car that does exactly what is planned."""


@njit(cache=True, nogil=True, inline="always")
def widened(tube, radius, yaw, slip, speed, v, change, bend, length, dt):  # type: ignore[no-untyped-def]
    """Return radius, yaw, slip and speed of a tube after a step.

    The radius is the distance from the line of the plan. A car that is ahead or behind on this line
    stays on it until the curvature changes: it turns off at another place than planned.

    Args:
        tube: `Tube` of the plan.
        radius: radius of the tube before the step [m].
        yaw: difference of the yaw before it [rad].
        slip: distance by which the car may be ahead or behind before it [m].
        speed: difference of the speed before it [m/s].
        v: speed at the start of the step [m/s].
        change: change of the acceleration from the step before, without its sign [m/s²].
        bend: change of the curvature, without its sign [1/m].
        length: length of the step [m].
        dt: duration of the step [s].
    """
    # A control that acts too early or too late changes the speed for good. A lag acts as a delay in
    # the long run; what remains is an offset.
    speed += tube.half * change
    slip += speed * dt + 0.5 * tube.lag * tube.lag * change
    turned = bend * (tube.half * v + slip)
    yaw += turned
    offset = 0.5 * tube.lag * v * v + TRANSIENT * tube.reach * v
    radius += turned * tube.reach + yaw * length + tube.lag * bend * offset
    return radius, yaw, slip, speed


@njit(cache=True, nogil=True, inline="always")
def overshoot(tube, slip, speed):  # type: ignore[no-untyped-def]
    """Return how far beyond the plan's end the car may come to rest [m]."""
    rest = speed + TRANSIENT * tube.lag * tube.braking
    return slip + 0.5 * rest * rest / tube.braking


@njit(cache=True, nogil=True, inline="always")
def grown(scene, ahead, aside):  # type: ignore[no-untyped-def]
    """Return a scene with a body that is longer and wider on every side [m]."""
    return Scene(
        scene.blocked,
        scene.resolution,
        scene.origin,
        scene.half_length + ahead,
        scene.half_width + aside,
    )


@njit(cache=True, nogil=True)
def radii(tube, states, controls, dt):  # type: ignore[no-untyped-def]
    """Return the radius of the tube at each state of a plan [m], (N+1,).

    That of the last state includes how far the car may come to rest beyond it.

    Args:
        tube: `Tube` of the plan.
        states: x, y, yaw, v of the plan, (N+1, 4).
        controls: a, κ of the plan, (N, 2).
        dt: step of the plan [s].
    """
    radius, yaw, slip, speed = tube.radius, tube.yaw, tube.slip, tube.speed
    before, curvature = tube.acceleration, tube.curvature
    found = np.full(states.shape[0], radius)
    for k in range(controls.shape[0]):
        a, kappa, v = controls[k, 0], controls[k, 1], states[k, 3]
        length = v * dt + 0.5 * a * dt * dt
        if length > LEAST:
            change, bend = abs(a - before), abs(kappa - curvature)
            radius, yaw, slip, speed = widened(
                tube, radius, yaw, slip, speed, v, change, bend, length, dt
            )
            before, curvature = a, kappa
        found[k + 1] = radius
    found[-1] += overshoot(tube, slip, speed)
    return found


def planned(car: CarLimits, bounds: ErrorBounds) -> CarLimits:
    """Return a car that paths and plans are made for, so that they stay safe with errors.

    Its body is larger by a usual radius of the tube. It takes curves more slowly, so that a car
    that is faster than planned can still turn as planned.

    Args:
        car: limits and body of the car.
        bounds: bounds of its errors.
    """
    if bounds.senses_exactly and bounds.moves_exactly:
        return car
    change, timing = car.acceleration + car.braking, 0.5 * bounds.jitter + TRANSIENT * bounds.lag
    # At lower speeds the steering limits the curvature, and not the tyres.
    slowest = math.sqrt(car.lateral_acceleration / car.max_curvature)
    share = (1.0 + timing * change / slowest) ** -2
    lateral = car.lateral_acceleration * share
    margin = bounds.apart(car.body.radius + AHEAD) + 0.5 * bounds.lag**2 * lateral
    body = car.body.inflated(margin)
    # A larger body cannot turn as tightly, see `CarLimits`.
    radius = max(car.turning_radius, 1.001 * body.radius / TIGHTEST)
    return replace(car, lateral_acceleration=lateral, turning_radius=radius, body=body)
