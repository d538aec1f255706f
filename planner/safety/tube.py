"""The tube of a plan: how far the body may be from where the car should carry the plan out.

The pose at which a plan starts is an estimate, its controls act a little earlier or later than
planned, and the car follows them with a lag. The lag is known, so what the car makes of a plan is
computed; the tube bounds what the other errors add up to, step by step. A plan is safe if the body,
grown by the tube's radius, is: docs/explanation/safety.md derives the terms.
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
from planner.motion.dynamics import pose_along

TRANSIENT = 0.368
"""Largest difference between the integrals of a first-order lag's step response and of a step that
is delayed by its time constant, divided by that time: 1/e."""
SETTLED = 5.0
"""Time after which the response to a control counts as complete, in time constants of the lag."""

LEAST = 1e-6
"""Length of a step [m], and speed [m/s], below which the car counts as standing."""
SUBSTEPS = 2
"""Steps into which a step of a plan is divided where the car follows it with a lag; in each, the
acceleration and the curvature are constant."""
AHEAD = 2.0
"""Distance ahead whose tube paths and plans keep away from obstacles [m]."""


class Tube(NamedTuple):
    """Where a plan's first control acts, and how far the body may be from there and later on.

    Attributes:
        radius: distance of the body from the place at which the first control acts, at most [m].
        yaw: difference of the yaw there, at most [rad].
        slip: distance along the plan by which the car may be ahead or behind, at most [m].
        speed: difference of the speed, at most [m/s].
        half: time by which a control may act earlier or later than planned, at most [s].
        reach: half diagonal of the body [m].
        braking: hardest braking [m/s²].
        acceleration: acceleration of the last control before the plan [m/s²].
        curvature: its curvature [1/m].
        lag: time constant with which the car follows its controls [s]. If it is above 0, plans
            begin this long after the first control acts, as if the lag were a delay.
        start: x, y, yaw, v of the car when the first control acts [m, m, rad, m/s].
        response: its acceleration [m/s²] and curvature [1/m] then.
    """

    radius: float
    yaw: float
    slip: float
    speed: float
    half: float
    reach: float
    braking: float
    acceleration: float
    curvature: float
    lag: float
    start: tuple[float, float, float, float]
    response: tuple[float, float]

    def mirrored(self) -> Tube:
        """Return the tube for a car with the opposite heading, which drives forward in reverse."""
        x, y, yaw, v = self.start
        return self._replace(
            curvature=-self.curvature,
            start=(x, y, yaw + math.pi, max(-v, 0.0)),
            response=(self.response[0], -self.response[1]),
        )

    def without_lag(self) -> Tube:
        """Return the tube of a car that follows its controls at once."""
        return self._replace(lag=0.0)


EXACT = Tube(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0))
"""The tube of a car that does exactly what is planned."""


@njit(cache=True, nogil=True, inline="always")
def widened(tube, radius, yaw, slip, speed, v, change, bend, turn, length, dt):  # type: ignore[no-untyped-def]
    """Return radius, yaw, slip and speed of a tube after a step.

    The radius is the distance from the line on which the car should drive. A car that is ahead or
    behind on this line stays on it until the curvature changes: it turns off at another place.

    Args:
        tube: `Tube` of the plan.
        radius: radius of the tube before the step [m].
        yaw: difference of the yaw before it [rad].
        slip: distance by which the car may be ahead or behind before it [m].
        speed: difference of the speed before it [m/s].
        v: speed at the start of the step [m/s].
        change: change of the commanded acceleration from the step before, without sign [m/s²].
        bend: change of the commanded curvature, without its sign [1/m].
        turn: change of the curvature that is driven, without its sign [1/m].
        length: length of the step [m].
        dt: duration of the step [s].
    """
    # A control that acts too early or too late changes speed and yaw for good.
    speed += tube.half * change
    slip += speed * dt
    turned = tube.half * bend * v + turn * slip
    yaw += turned
    radius += turned * tube.reach + yaw * length
    return radius, yaw, slip, speed


@njit(cache=True, nogil=True, inline="always")
def overshoot(tube, slip, speed):  # type: ignore[no-untyped-def]
    """Return how far beyond the plan's end the car may come to rest [m]."""
    return slip + speed * (tube.lag + 0.5 * speed / tube.braking)


@njit(cache=True, nogil=True, inline="always")
def lag_shares(lag, time):  # type: ignore[no-untyped-def]
    """Return how much is left of the difference between a response and its command.

    Args:
        lag: time constant of the response [s].
        time: time since the command began to act [s].

    Returns:
        The share in the mean over that time, and the share at its end.
    """
    left = math.exp(-time / lag)
    return (1.0 - left) * lag / time, left


@njit(cache=True, nogil=True)
def carried_out(tube, states, controls, dt):  # type: ignore[no-untyped-def]
    """Return what a car without other errors than its lag makes of a plan.

    Args:
        tube: `Tube` of the plan.
        states: x, y, yaw, v of the plan, (N+1, 4).
        controls: a, κ of the plan, (N, 2).
        dt: step of the plan [s].

    Returns:
        States (M+1, 4), the mean a, κ in each step (M, 2), the commands (M, 2), and the duration of
        a step [s]. With a lag, the steps are shorter than those of the plan, and the car brakes on
        for some time after the plan.
    """
    if tube.lag == 0.0:
        return states, controls, controls, dt
    step, count = dt / SUBSTEPS, SUBSTEPS * controls.shape[0]
    steps = count + math.ceil(SETTLED * tube.lag / step)
    driven, applied = np.empty((steps + 1, 4)), np.empty((steps, 2))
    commands = np.empty((steps, 2))
    mean, left = lag_shares(tube.lag, step)
    driven[0] = tube.start
    a, kappa = tube.response
    for k in range(steps):
        i = min(k // SUBSTEPS, controls.shape[0] - 1)
        commands[k] = controls[i]
        # A car that should stand brakes.
        if k >= count or (states[i, 3] < LEAST and states[i + 1, 3] < LEAST):
            commands[k, 0] = -tube.braking
        x, y, yaw, v = driven[k, 0], driven[k, 1], driven[k, 2], driven[k, 3]
        if v < LEAST:
            a = max(a, 0.0)
        command, asked = commands[k, 0], commands[k, 1]
        acts = max(command + (a - command) * mean, -v / step)
        bends = asked + (kappa - asked) * mean
        a, kappa = command + (a - command) * left, asked + (kappa - asked) * left
        s = v * step + 0.5 * acts * step * step
        driven[k + 1, :3] = pose_along(x, y, yaw, bends, s)
        driven[k + 1, 3] = max(v + acts * step, 0.0)
        applied[k, 0], applied[k, 1] = acts, bends
    return driven, applied, commands, step


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
def radii(tube, states, controls, commands, dt):  # type: ignore[no-untyped-def]
    """Return the radius of the tube at each state of a plan that is carried out [m], (M+1,).

    That of the last state includes how far the car may come to rest beyond it.

    Args:
        tube: `Tube` of the plan.
        states: x, y, yaw, v as `carried_out` returns them, (M+1, 4).
        controls: a, κ in each step, (M, 2).
        commands: the commanded ones, (M, 2).
        dt: duration of a step [s].
    """
    radius, yaw, slip, speed = tube.radius, tube.yaw, tube.slip, tube.speed
    before, curvature, bent = tube.acceleration, tube.curvature, tube.response[1]
    found = np.full(states.shape[0], radius)
    for k in range(controls.shape[0]):
        a, kappa, v = controls[k, 0], controls[k, 1], states[k, 3]
        length = v * dt + 0.5 * a * dt * dt
        if length > LEAST:
            change, bend = abs(commands[k, 0] - before), abs(commands[k, 1] - curvature)
            radius, yaw, slip, speed = widened(
                tube, radius, yaw, slip, speed, v, change, bend, abs(kappa - bent), length, dt
            )
            before, curvature, bent = commands[k, 0], commands[k, 1], kappa
        found[k + 1] = radius
    found[-1] += overshoot(tube, slip, speed)
    return found


@njit(cache=True, nogil=True)
def growth(tube, states, controls, dt):  # type: ignore[no-untyped-def]
    """Return how far the body may be from each state of a plan [m], (N+1,).

    This is the radius of the tube, and how far the lag leads away from the plan.

    Args:
        tube: `Tube` of the plan.
        states: x, y, yaw, v of the plan, (N+1, 4).
        controls: a, κ of the plan, (N, 2).
        dt: step of the plan [s].
    """
    driven, applied, commands, step = carried_out(tube, states, controls, dt)
    found = radii(tube, driven, applied, commands, step)
    if tube.lag == 0.0:
        return found
    off = np.empty(states.shape[0])
    last = driven.shape[0] - 1
    for k in range(states.shape[0]):
        time = min((k * dt + tube.lag) / step, float(last))
        i = min(int(time), last - 1)
        x, y, yaw = driven[i, :3] + (time - i) * (driven[i + 1, :3] - driven[i, :3])
        apart = math.hypot(x - states[k, 0], y - states[k, 1])
        off[k] = found[i + 1] + apart + tube.reach * abs(yaw - states[k, 2])
    return off


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
    body = car.body.inflated(bounds.apart(car.body.radius + AHEAD))
    # A larger body cannot turn as tightly, see `CarLimits`.
    radius = max(car.turning_radius, 1.001 * body.radius / TIGHTEST)
    return replace(car, lateral_acceleration=lateral, turning_radius=radius, body=body)
