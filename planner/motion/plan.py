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
        states: x, y, yaw, v at the start and after each step, (N+1, 4) [m, m, rad, m/s].
        controls: a, κ of each step, (N, 2) [m/s², 1/m]; a > 0 raises |v| in either gear.
        gear: 1 forward; -1 in reverse, where the speeds are negative.
    """

    states: NDArray[np.float64]
    controls: NDArray[np.float64]
    gear: int = 1

    def poses(self, dt: float, spacing: float) -> NDArray[np.float64]:
        """Return poses (n, 3) along the plan, at most `spacing` [m] apart; `dt` is its step [s]."""
        forward = self if self.gear > 0 else self.mirrored()
        poses = np.asarray(swept(forward.states, forward.controls, dt, spacing))
        return poses if self.gear > 0 else poses + np.array([0.0, 0.0, np.pi])

    def mirrored(self) -> Plan:
        """Return the same motion for a car with the opposite heading, in the other gear."""
        controls = self.controls * np.array([1.0, -1.0])
        return Plan(mirrored(self.states), controls, -self.gear)


def mirrored(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the states (…, 4) for the opposite heading, so that reverse driving becomes forward.

    The body covers the same cells, since its centre is at x, y.
    """
    return np.asarray(states * np.array([1.0, 1.0, 1.0, -1.0]) + np.array([0.0, 0.0, np.pi, 0.0]))
