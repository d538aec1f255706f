"""A solution: the plan that a solve came to, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from planner.motion.plan import Plan


class Status(StrEnum):
    """How a solve ended."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration_limit"
    QP_FAILED = "qp_failed"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solve came to.

    Attributes:
        plan: the best found, which may be no good.
        cost: of the optimal-control problem, lower is better.
        status: how the solve ended.
    """

    plan: Plan
    cost: float
    status: Status

    @property
    def failed(self) -> bool:
        """Whether the solver says so itself."""
        return self.status in (Status.QP_FAILED, Status.NOT_FINITE)
