"""A plan: the motion that the MPC finds and the car drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.motion.dynamics import swept


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion within the car's limits.

    Attributes:
        states: (N+1, 4) x, y, yaw, v.
        controls: (N, 2) a, κ; a acts along the gear.
        gear: 1 forward; -1 in reverse, where the speeds are negative.
    """

    states: NDArray[np.float64]
    controls: NDArray[np.float64]
    gear: int = 1

    def poses(self, dt: float, spacing: float) -> NDArray[np.float64]:
        """Return poses along the plan, at most `spacing` [m] apart: (n, 3)."""
        forward = self if self.gear > 0 else self.mirrored()
        poses = np.asarray(swept(forward.states, forward.controls, dt, spacing))
        return poses if self.gear > 0 else poses + np.array([0.0, 0.0, np.pi])

    def mirrored(self) -> Plan:
        """Return the same motion of a car that looks the other way, and is in the other gear."""
        controls = self.controls * np.array([1.0, -1.0])
        return Plan(mirrored(self.states), controls, -self.gear)


def mirrored(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the states (…, 4) of a car that looks the other way: driving in reverse becomes
    forward.

    The body's centre is its (x, y), so it covers the same cells.
    """
    return np.asarray(states * np.array([1.0, 1.0, 1.0, -1.0]) + np.array([0.0, 0.0, np.pi, 0.0]))
