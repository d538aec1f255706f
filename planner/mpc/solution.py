"""The result of a solve of the MPC: a plan, and how the solve ended."""

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
    """The result of a solve.

    Attributes:
        plan: the best plan found, which may be unsafe.
        cost: value of the plan's merit; lower is better.
        status: how the solve ended.
    """

    plan: Plan
    cost: float
    status: Status

    @property
    def failed(self) -> bool:
        """Whether the solver itself reports a failure."""
        return self.status in (Status.QP_FAILED, Status.NOT_FINITE)
