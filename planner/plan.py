"""A plan: what the MPC makes, and the car drives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from planner.dynamics import swept


class Status(StrEnum):
    """How a solve ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    QP_FAILED = "qp_failed"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion that ends stopped.

    Attributes:
        states: (N+1, 4) x, y, yaw, v.
        controls: (N, 2) a, κ.
        cost: of the optimal-control problem, lower is better.
        status: how its solve ended.
        iterations: times that the problem's matrices were set up for it.
    """

    states: NDArray[np.float64]
    controls: NDArray[np.float64]
    cost: float
    status: Status
    iterations: int

    def poses(self, dt: float, spacing: float) -> NDArray[np.float64]:
        """Poses along the plan, at most `spacing` [m] apart: (n, 3)."""
        return np.asarray(swept(self.states, self.controls, dt, spacing))
