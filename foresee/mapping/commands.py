"""A control as a command of a robot: a speed and a yaw rate, or a speed and a steering angle.

docs/how-to/units_and_frames.md explains the frames and the reference point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import REST, TICK


@dataclass(frozen=True)
class TwistCommand:
    """A command of a robot that takes a speed and a yaw rate, as in geometry_msgs/Twist.

    Attributes:
        speed: speed of (x, y) along the heading, negative in reverse [m/s]: `linear.x`.
        yaw_rate: yaw rate, positive to the left [rad/s]: `angular.z`.
    """

    speed: float
    yaw_rate: float


@dataclass(frozen=True)
class SteeringCommand:
    """A command of a car with front steering, as in ackermann_msgs/AckermannDrive.

    Attributes:
        speed: speed of the rear axle's centre, negative in reverse [m/s].
        acceleration: magnitude of its change of speed, braking included [m/s²].
        steering_angle: angle of a front wheel in the middle, positive to the left [rad].
    """

    speed: float
    acceleration: float
    steering_angle: float


def twist_of(control: Control, speed: float, car: CarLimits, dt: float = TICK) -> TwistCommand:
    """Return a control as the speed and the yaw rate at the end of its tick.

    Args:
        control: control for one tick.
        speed: speed when the control begins to act, negative in reverse [m/s]: `Decision.speed`.
        car: limits of the car, whose top speed in the gear is not exceeded.
        dt: length of the tick [s].

    Raises:
        ValueError: if the speed is not finite.
    """
    end = _end_speed(control, speed, car, dt)
    if control.turn_rate != 0.0 and abs(speed) < REST:
        return TwistCommand(0.0, min(max(control.turn_rate, -car.turn_rate), car.turn_rate))
    return TwistCommand(end, end * control.curvature)


def steering_of(
    control: Control,
    speed: float,
    car: CarLimits,
    wheelbase: float,
    ahead: float = 0.0,
    dt: float = TICK,
) -> SteeringCommand:
    """Return a control as the speed at the end of its tick, and the steering angle of its arc.

    The kinematic bicycle model: the rear axle moves along the heading, on an arc of curvature
    tan(steering angle) / wheelbase. A point at a distance `ahead` of it moves on a wider arc around
    the same centre.

    Args:
        control: control for one tick.
        speed: speed of (x, y) when the control begins to act, negative in reverse [m/s].
        car: limits of the car, whose top speed in the gear is not exceeded.
        wheelbase: distance between the axles [m].
        ahead: distance of (x, y) ahead of the rear axle [m]; 0: (x, y) is the rear axle.
        dt: length of the tick [s].

    Raises:
        ValueError: if the speed is not finite, the wheelbase is not positive, or no steering angle
            gives the arc, or the car is to turn on the spot.
    """
    if control.turn_rate != 0.0:
        raise ValueError(
            f"turn_rate is {control.turn_rate} rad/s, but a car with front steering cannot turn on "
            "the spot: use twist_of"
        )
    if not wheelbase > 0.0:
        raise ValueError(f"wheelbase is {wheelbase} m, it must be positive")
    square = 1.0 - (control.curvature * ahead) ** 2
    if not square > 0.0:
        raise ValueError(
            f"a point {ahead} m ahead of the rear axle cannot move on an arc of curvature "
            f"{control.curvature} 1/m, which must be below {1.0 / abs(ahead):g} 1/m"
        )
    # Ratio of the rear axle's radius, and of its speed, to that of (x, y).
    share = math.sqrt(square)
    return SteeringCommand(
        speed=share * _end_speed(control, speed, car, dt),
        acceleration=share * abs(control.acceleration),
        steering_angle=math.atan(wheelbase * control.curvature / share),
    )


def _end_speed(control: Control, speed: float, car: CarLimits, dt: float) -> float:
    """Return the speed after a tick [m/s]; the gear changes at standstill only."""
    if not math.isfinite(speed):
        raise ValueError(f"speed is {speed} m/s, it must be finite")
    gear = control.gear if abs(speed) < REST else math.copysign(1.0, speed)
    top = car.v_max if gear > 0 else car.reverse
    # Adding 0 turns a negative zero into a plain one.
    return gear * min(max(abs(speed) + control.acceleration * dt, 0.0), top) + 0.0
