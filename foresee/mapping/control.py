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
    """

    acceleration: float
    curvature: float
    gear: int = 1
