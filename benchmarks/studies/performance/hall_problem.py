"""The MPC's problem in a hall as casadi functions, for solvers that compute derivatives themselves.

Dynamics, costs and limits are those of `planner.mpc.mpc`, along the path through the middle of the
hall. Each part is a function of scalar symbols (SX), which casadi evaluates and differentiates
several times as fast as matrix symbols (MX). The latter only call the parts and read the map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from benchmarks.studies.performance.hall import BEHIND, SIDE
from foresee.mapping.conventions import RESOLUTION
from planner.mpc.mpc import MPC

X, U = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
"""Symbols of the state (4,) and the control (2,) of a stage."""


@dataclass(frozen=True)
class Problem:
    """One stage of the problem: functions of its state (4,) and control (2,).

    Attributes:
        mpc: MPC whose settings and limits are used.
    """

    mpc: MPC

    @property
    def keeps_inside(self) -> bool:
        """Whether a clearance is a constraint; otherwise only a cost keeps the body off posts."""
        return self.mpc.required > 0.0

    @property
    def lateral(self) -> float:
        """Largest lateral acceleration of a plan [m/s²]."""
        return self.mpc.limits.planned_cornering

    @cached_property
    def successor(self) -> ca.Function:
        """Function from state and control to the state after one step, (4,)."""
        dt = self.mpc.config.dt
        s = X[3] * dt + U[0] * dt**2 / 2
        half = U[1] * s / 2
        chord = s * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
        after = ca.vertcat(
            X[0] + chord * ca.cos(X[2] + half),
            X[1] + chord * ca.sin(X[2] + half),
            X[2] + U[1] * s,
            X[3] + U[0] * dt,
        )
        return ca.Function("successor", [X, U], [after])

    @cached_property
    def laterals(self) -> ca.Function:
        """Function from state and control to the lateral accelerations at a step's ends, (2,)."""
        after = X[3] + U[0] * self.mpc.config.dt
        return ca.Function("laterals", [X, U], [ca.vertcat(X[3] ** 2 * U[1], after**2 * U[1])])

    @cached_property
    def effort(self) -> ca.Function:
        """Function from a control to its cost, except for the cost of its change."""
        weights = self.mpc.config.effort
        return ca.Function("effort", [U], [weights[0] * U[0] ** 2 + weights[1] * U[1] ** 2])

    @cached_property
    def standing(self) -> ca.Function:
        """Function from a state to its cost: distance from the path, less progress along it."""
        return ca.Function("standing", [X], [self._way(self.mpc.config.contour)])

    @cached_property
    def ending(self) -> ca.Function:
        """Function from the last state to its cost."""
        offset, heading = self.mpc.config.final
        return ca.Function("ending", [X], [self._way(offset) + heading * (1 - ca.cos(X[2]))])

    def _way(self, weight: float) -> Any:
        return -self.mpc.config.progress * (X[0] + BEHIND) + 0.5 * weight * X[1] ** 2

    @cached_property
    def closeness(self) -> ca.Function:
        """Function from clearances (2,) to the cost of being close to posts."""
        c, clearances = self.mpc.config, ca.SX.sym("clearances", 2)
        lacking = ca.fmax(0, self.mpc.required + c.comfort - clearances)
        return ca.Function("closeness", [clearances], [0.5 * c.closeness * ca.sumsqr(lacking)])

    def clearances(self, x: Any, origin: Any, field: Any) -> Any:
        """Return the clearances of the body's two circles, (2,) [m].

        They are computed as in `planner.mpc.condense.clearances`.

        Args:
            x: state, (4,).
            origin: lower-left corner of the map, (2,) [m].
            field: clearance of each cell of the map, row by row, (SIDE²,) [m].
        """
        cells, fractions = self._place(x, origin)
        return self._cubic(field[cells], fractions)

    @cached_property
    def _place(self) -> ca.Function:
        """Function from state and origin to the cells around both circles' centres (32,), and the
        positions of the centres among them (4,)."""
        origin, offset = ca.SX.sym("origin", 2), self.mpc.limits.body.length / 4
        cells: list[Any] = []
        fractions: list[Any] = []
        for side in (1.0, -1.0):
            ahead = side * offset * ca.vertcat(ca.cos(X[2]), ca.sin(X[2]))
            at = ca.fmin(ca.fmax((X[:2] + ahead - origin) / RESOLUTION - 0.5, 1.0), SIDE - 2.001)
            first = ca.floor(at)
            fractions.append(at - first)
            cells += [
                (first[1] - 1 + i) * SIDE + first[0] - 1 + j for i in range(4) for j in range(4)
            ]
        return ca.Function(
            "place",
            [X, origin],
            [ca.vertcat(*cells), ca.vertcat(*fractions)],
            {"is_diff_in": [True, False], "is_diff_out": [False, True]},
        )

    @cached_property
    def _cubic(self) -> ca.Function:
        """Function that interpolates the clearances at these cells by cubic convolution, (2,)."""
        patch, t = ca.SX.sym("patch", 32), ca.SX.sym("t", 4)
        read = [
            ca.mtimes([_keys(t[2 * i]).T, ca.reshape(cells, 4, 4), _keys(t[2 * i + 1])])
            for i, cells in enumerate(ca.vertsplit(patch, 16))
        ]
        return ca.Function("cubic", [patch, t], [ca.vertcat(*read)], {"is_diff_in": [False, True]})


def _keys(t: Any) -> Any:
    return ca.vertcat(
        ((-0.5 * t + 1) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1,
        ((-1.5 * t + 2) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
