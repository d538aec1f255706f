"""A plan: what the MPC makes, and the car drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.dynamics import swept


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion within the car's limits.

    Attributes:
        states: (N+1, 4) x, y, yaw, v.
        controls: (N, 2) a, κ.
    """

    states: NDArray[np.float64]
    controls: NDArray[np.float64]

    def poses(self, dt: float, spacing: float) -> NDArray[np.float64]:
        """Poses along the plan, at most `spacing` [m] apart: (n, 3)."""
        return np.asarray(swept(self.states, self.controls, dt, spacing))
