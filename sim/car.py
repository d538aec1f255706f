"""The simulated car: its motion with bounded acceleration, and its collisions.

It does not use the planner's model of the car (`planner.motion.dynamics`), so that each can be
tested against the other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foresee.mapping.body import Body, Scene, first_contact
from foresee.mapping.car_limits import JUDGE_MARGIN, CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import REST
from sim.world import World


class DubinsCar:
    """Simulates a Dubins car with bounded acceleration, in closed form.

    The state is [x, y, yaw, v] [m, m, rad, m/s]; v is negative when the car rolls backwards. The
    gear changes at standstill only: a car that moves stays in the gear of its motion, whatever the
    control asks for.

    Args:
        limits: the car's limits and its body; None: the defaults.
    """

    def __init__(self, limits: CarLimits | None = None) -> None:
        self.limits = limits or CarLimits()

    def step(self, state: ArrayLike, control: Control, dt: float) -> NDArray[np.float64]:
        """Return the state (4,) after `dt` [s] of constant control.

        Controls beyond the limits are clipped. |v| saturates at 0 and at the gear's top speed,
        inside the step too, so the path is one circular arc.

        Raises:
            ValueError: if an argument is not finite, `dt` is negative, the gear is neither 1 nor
                -1, or a car is asked to reverse or to turn on the spot that cannot.
        """
        angle = self._turn(state, control, dt)
        if angle != 0.0:
            x, y, yaw, _ = (float(value) for value in np.asarray(state, dtype=np.float64))
            return np.array([x, y, wrap(yaw + angle), 0.0])
        x, y, yaw, length, v_end, curvature = self._arc(state, control, dt)
        return np.array([*along_arc(x, y, yaw, curvature, length), v_end])

    def motion(
        self, state: ArrayLike, control: Control, dt: float, spacing: float
    ) -> NDArray[np.float64]:
        """Return poses (n, 3) along a step, without its start and with its end.

        No point of the body moves further than `spacing` [m] from one pose to the next.

        Raises:
            ValueError: as `step`, and if `spacing` is not positive.
        """
        if not spacing > 0:
            raise ValueError(f"spacing is {spacing} m, it must be positive")
        angle = self._turn(state, control, dt)
        if angle != 0.0:
            x, y, yaw = (float(value) for value in np.asarray(state, dtype=np.float64)[:3])
            count = max(1, math.ceil(abs(angle) * self.limits.body.radius / spacing))
            return np.array([(x, y, yaw + angle * i / count) for i in range(1, count + 1)])
        x, y, yaw, length, _, curvature = self._arc(state, control, dt)
        # A point of the body moves at most (1 + |κ|·radius) times as far as its centre.
        swept = abs(length) * (1.0 + abs(curvature) * self.limits.body.radius)
        count = max(1, math.ceil(swept / spacing))
        steps = (length * i / count for i in range(1, count + 1))
        return np.array([along_arc(x, y, yaw, curvature, s) for s in steps])

    def collides(self, world: World, state: ArrayLike, control: Control, dt: float) -> bool:
        """Return whether the body meets a solid cell anywhere along a step."""
        poses = self.motion(state, control, dt, 2.0 * JUDGE_MARGIN)
        return collides(world, poses, self.limits.body, JUDGE_MARGIN)

    def _turn(self, state: ArrayLike, control: Control, dt: float) -> float:
        """Return the angle by which the car turns on the spot in a step [rad], 0 if it does not."""
        if control.turn_rate == 0.0:
            return 0.0
        state = np.asarray(state, dtype=np.float64)
        if not (np.isfinite(state).all() and math.isfinite(control.turn_rate + dt) and dt >= 0):
            raise ValueError(f"state {state!r}, {control}, dt {dt} must be finite, dt not negative")
        most = self.limits.turn_rate
        if most == 0.0:
            raise ValueError(
                f"turn_rate is {control.turn_rate} rad/s, but the car cannot turn on the spot"
            )
        if abs(float(state[3])) >= REST:
            return 0.0
        return min(max(control.turn_rate, -most), most) * dt

    def _arc(
        self, state: ArrayLike, control: Control, dt: float
    ) -> tuple[float, float, float, float, float, float]:
        """Return the arc of a step: x, y, yaw at its start, its length, end speed and curvature.

        The length is negative in reverse.
        """
        x, y, yaw, v = (float(value) for value in np.asarray(state, dtype=np.float64))
        acceleration, curvature = control.acceleration, control.curvature
        if not math.isfinite(x + y + yaw + v + acceleration + curvature + dt):
            raise ValueError(f"state {state!r}, {control}, dt {dt} must be finite")
        if dt < 0:
            raise ValueError(f"dt {dt} s may not be negative")
        limits = self.limits
        gear = self._gear(v, control.gear)
        acceleration = min(max(acceleration, -limits.braking), limits.acceleration)
        top = limits.v_max if gear > 0 else limits.reverse
        length, end_speed = travel(abs(v), acceleration, dt, top)
        fastest = max(abs(v), end_speed)
        tightest = limits.max_curvature
        if tightest * fastest**2 > limits.lateral_acceleration:
            tightest = limits.lateral_acceleration / fastest**2
        curvature = min(max(curvature, -tightest), tightest)
        # Adding 0 turns a negative zero, the speed after braking in reverse, into a plain one.
        return x, y, yaw, gear * length, gear * end_speed + 0.0, curvature

    def _gear(self, v: float, asked: int) -> float:
        """Return the gear of a step: that of the motion, or at standstill the one asked for."""
        if asked not in (1, -1):
            raise ValueError(f"gear is {asked}, it must be 1 or -1")
        if self.limits.reverse == 0 and (asked < 0 or v < 0):
            what = f"speed {v} m/s is negative" if v < 0 else "gear is -1"
            raise ValueError(f"{what}, but the car has no reverse gear")
        return asked if abs(v) < REST else math.copysign(1.0, v)


def travel(v: float, acceleration: float, dt: float, v_max: float) -> tuple[float, float]:
    """Return the distance [m] and the final speed [m/s] after `dt` [s] of constant acceleration.

    The speed saturates at 0 and at `v_max`.
    """
    if acceleration < 0 and v + acceleration * dt <= 0:
        return -0.5 * v**2 / acceleration, 0.0
    if acceleration > 0 and v + acceleration * dt > v_max:
        rising = max(0.0, (v_max - v) / acceleration)
        v_end = max(v, v_max)
        return 0.5 * (v + v_end) * rising + v_end * (dt - rising), v_end
    return v * dt + 0.5 * acceleration * dt**2, v + acceleration * dt


def along_arc(
    x: float, y: float, yaw: float, curvature: float, length: float
) -> tuple[float, float, float]:
    """Return the pose after a length [m] along an arc, which is straight at a curvature of 0."""
    half = 0.5 * curvature * length
    chord = length * sinc(half)
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), wrap(yaw + 2 * half)


def sinc(angle: float) -> float:
    """Return sin(angle) / angle, which is 1 at 0."""
    # The next term of the series, angle⁴/120, is below rounding here.
    return 1.0 - angle * angle / 6.0 if abs(angle) < 1e-4 else math.sin(angle) / angle


def wrap(angle: float) -> float:
    """Return the same angle in (−π, π] [rad]."""
    wrapped = math.remainder(angle, 2 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def collides(world: World, poses: ArrayLike, body: Body, margin: float = 0.0) -> bool:
    """Return whether a body meets a solid cell at any of the poses, or between them.

    The body is grown by a margin. If a point of the body moves by at most twice the margin from
    pose to pose, all that it covers between two poses is covered at one of the two as well.

    This test judges the planner, and is independent of the planner's own in
    `planner.safety.collision`: it reads the true map, its poses are those of the simulator's
    motion, and their spacing bounds how far a corner of the body moves. Keep it so: an error in
    the planner's test must not hide the collisions that it causes. The two share only
    `foresee.mapping.body`, which says whether a rectangle meets a cell, and is tested by itself.

    Args:
        world: the true map.
        poses: x, y, yaw of the poses, (n, 3) [m, m, rad].
        body: rectangle of the car.
        margin: margin by which the body is grown [m].
    """
    frame = world.grid.frame
    grown = body.inflated(margin)
    array = np.atleast_2d(np.asarray(poses, dtype=np.float64))
    return bool(first_contact(Scene(world.solid, *frame.lattice, *grown.halves), array) >= 0)
