"""The control of the car, which a planner decides on and the simulated car carries out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Control:
    """A control, held for one tick.

    Attributes:
        acceleration: acceleration along the gear [m/s²]: positive values raise the speed in either
            gear, negative ones brake to standstill and never beyond.
        curvature: curvature of the arc, positive to the left [1/m].
        gear: 1 forward, -1 in reverse.
        turn_rate: yaw rate at standstill of a car that turns on the spot, positive to the left
            [rad/s]. While it is not 0 and the car stands, the acceleration and the curvature have
            no effect; while the car moves, it has none itself.
    """

    acceleration: float
    curvature: float
    gear: int = 1
    turn_rate: float = 0.0
