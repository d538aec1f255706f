"""The velocity that carries out a control."""

from __future__ import annotations

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import TICK


def velocity_of(control: Control, speed: float, car: CarLimits) -> tuple[float, float]:
    """Return the velocity at the end of a tick with a control.

    Args:
        control: control for one tick.
        speed: speed at its start, negative in reverse [m/s].
        car: the car's limits.

    Returns:
        Speed [m/s], negative in reverse, and yaw rate [rad/s].
    """
    top = car.v_max if control.gear > 0 else car.reverse
    reached = min(max(abs(speed) + control.acceleration * TICK, 0.0), top)
    return control.gear * reached, control.gear * reached * control.curvature
