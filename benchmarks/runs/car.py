"""The car of a comparison."""

from __future__ import annotations

from benchmarks.runs.settings import Settings
from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits


def limits_for(settings: Settings) -> CarLimits:
    """Return the limits and the body of the car that a run's settings describe."""
    return CarLimits(
        v_max=settings.v_max,
        acceleration=settings.acceleration,
        braking=settings.braking,
        lateral_acceleration=settings.lateral_acceleration,
        turning_radius=settings.turning_radius,
        body=Body(settings.length, settings.width),
        reverse=0.0 if settings.vehicle == "dubins" else settings.reverse,
        turn_rate=settings.turn_rate if settings.vehicle == "differential" else 0.0,
    )
