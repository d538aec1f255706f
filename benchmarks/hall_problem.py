"""The MPC's problem in a hall as expressions of casadi's, for solvers that derive it themselves.

The same dynamics, costs and limits as in `planner.mpc`, along the path through the hall's middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from benchmarks.hall import BEHIND, SIDE
from planner.mpc import MPC


@dataclass(frozen=True)
class Problem:
    """One stage of the problem, in symbols.

    Attributes:
        mpc: whose settings and limits count.
    """

    mpc: MPC

    @property
    def keeps_inside(self) -> bool:
        """Whether the body must keep off, or is kept off by cost alone."""
        return self.mpc.required > 0.0

    @property
    def lateral(self) -> float:
        """Most lateral acceleration of a plan [m/s²]."""
        return 0.99 * self.mpc.limits.lateral_acceleration

    def successor(self, x: Any, u: Any) -> Any:
        """The state (4,) after one step."""
        dt = self.mpc.config.dt
        s = x[3] * dt + u[0] * dt**2 / 2
        half = u[1] * s / 2
        chord = s * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
        return ca.vertcat(x[0] + chord * ca.cos(x[2] + half), x[1] + chord * ca.sin(x[2] + half),
                          x[2] + u[1] * s, x[3] + u[0] * dt)  # fmt: skip

    def laterals(self, x: Any, u: Any) -> Any:
        """Lateral acceleration at both ends of a step (2,) [m/s²]."""
        return ca.vertcat(x[3] ** 2 * u[1], (x[3] + u[0] * self.mpc.config.dt) ** 2 * u[1])

    def effort(self, u: Any) -> Any:
        """What a control costs, but for its change."""
        weights = self.mpc.config.effort
        return weights[0] * u[0] ** 2 + weights[1] * u[1] ** 2

    def clearances(self, x: Any, origin: Any, field: Any) -> Any:
        """Clearance of the body's two circles (2,) [m]."""
        offset = self.mpc.limits.body.length / 4
        return ca.vertcat(*(
            _cubic(field, (x[0] + side * offset * ca.cos(x[2]) - origin[0]) / 0.05 - 0.5,
                   (x[1] + side * offset * ca.sin(x[2]) - origin[1]) / 0.05 - 0.5)
            for side in (1.0, -1.0)
        ))  # fmt: skip

    def standing(self, x: Any, is_last: bool) -> Any:
        """What it costs to be in a state: the way still to go, and off the path."""
        c = self.mpc.config
        weight = c.final[0] if is_last else c.contour
        cost = -c.progress * (x[0] + BEHIND) + 0.5 * weight * x[1] ** 2
        return cost + c.final[1] * (1 - ca.cos(x[2])) if is_last else cost

    def closeness(self, clearances: Any) -> Any:
        """What it costs to be close to posts."""
        c = self.mpc.config
        lacking = ca.fmax(0, self.mpc.required + c.comfort - clearances)
        return 0.5 * c.closeness * ca.sumsqr(lacking)


def _cubic(field: Any, u: Any, w: Any) -> Any:
    """The field at a place by cubic convolution, as `planner.condense.clearances` reads it."""
    u = ca.fmin(ca.fmax(u, 1.0), SIDE - 2.001)
    w = ca.fmin(ca.fmax(w, 1.0), SIDE - 2.001)
    col, row = ca.floor(u), ca.floor(w)
    index = ca.vertcat(*(
        (row - 1 + i) * SIDE + col - 1 + j for i in range(4) for j in range(4)
    ))  # fmt: skip
    patch = ca.reshape(field[index], 4, 4)
    return ca.mtimes([_keys(u - col).T, patch, _keys(w - row)])


def _keys(t: Any) -> Any:
    return ca.vertcat(((-0.5 * t + 1) * t - 0.5) * t, (1.5 * t - 2.5) * t * t + 1,
                      ((-1.5 * t + 2) * t + 0.5) * t, (0.5 * t - 0.5) * t * t)  # fmt: skip
