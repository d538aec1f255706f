"""Peers of the MPC: general solvers in casadi (IPOPT, fatrop), on the whole sparse problem."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.hall import SIDE, Solve, Solver, Tick
from benchmarks.studies.performance.hall_problem import Problem
from planner.mpc.mpc import MPC

IPOPT = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-4,
    "ipopt.mu_init": 1e-3,
    "ipopt.warm_start_init_point": "yes",
}
"""Settings with which IPOPT is fastest here."""
COMPILED = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
"""Settings with which casadi writes the problem's functions as C and compiles them with gcc."""


def general(mpc: MPC, plugin: str, compiled: bool) -> Solver:
    """Return a solver that starts from its own last solution, including the multipliers.

    Args:
        mpc: MPC whose problem is solved.
        plugin: "ipopt" or "fatrop".
        compiled: whether the problem's functions are compiled to machine code.
    """
    n, car, problem = mpc.stages, mpc.limits, Problem(mpc)
    # The previous curvature κ is part of the state, so that no cost depends on two stages.
    xs = [ca.MX.sym(f"x{k}", 5) for k in range(n + 1)]
    us = [ca.MX.sym(f"u{k}", 2) for k in range(n)]
    start, field = ca.MX.sym("start", 7), ca.MX.sym("field", SIDE * SIDE)
    cost: Any = 0
    g: list[Any] = []
    low: list[float] = []
    high: list[float] = []
    names: list[tuple[int, str, int]] = []

    def constrain(k: int, name: str, value: Any, lower: list[float], upper: list[float]) -> None:
        g.append(value)
        low.extend(lower)
        high.extend(upper)
        names.extend((k, name, i) for i in range(len(lower)))

    softest = [-car.braking, -car.max_curvature]
    hardest = [car.acceleration, car.max_curvature]
    for k in range(n + 1):
        # The state without κ.
        x = xs[k][:4]
        if k < n:
            u = us[k]
            after = ca.vertcat(problem.successor(x, u), u[1])
            constrain(k, "step", xs[k + 1] - after, [0.0] * 5, [0.0] * 5)
        if k == 0:
            constrain(k, "start", xs[0] - start[:5], [0.0] * 5, [0.0] * 5)
        if k < n:
            lateral, limit = problem.laterals(x, u), problem.lateral
            constrain(k, "lateral", lateral, [-limit] * 2, [limit] * 2)
            constrain(k, "control", u, softest, hardest)
            cost += problem.effort(u) + mpc.config.smoothness * (u[1] - xs[k][4]) ** 2
        constrain(k, "speed", x[3], [0.0], [car.v_max if k < n else 0.0])
        if k > 0:
            clearances = problem.clearances(x, start[5:], field)
            cost += problem.closeness(clearances)
            cost += problem.standing(x) if k < n else problem.ending(x)
            if problem.keeps_inside:
                constrain(k, "inside", clearances, [mpc.required] * 2, [np.inf] * 2)
    variables = [v for k in range(n) for v in (xs[k], us[k])] + [xs[n]]
    options: dict[str, Any] = {"print_time": False, "calc_lam_p": False}
    if plugin == "ipopt":
        options |= IPOPT
    else:
        equal = [a == b for a, b in zip(low, high, strict=True)]
        options |= {
            "fatrop.print_level": 0,
            "structure_detection": "auto",
            "equality": equal,
            "fatrop.tol": 1e-4,
            "fatrop.mu_init": 1e-3,
        }
    if compiled:
        options |= COMPILED
    nlp = {
        "x": ca.vertcat(*variables),
        "p": ca.vertcat(start, field),
        "f": cost,
        "g": ca.vertcat(*g),
    }
    solver = ca.nlpsol("solver", plugin, nlp, options)
    duals: dict[str, Any] = {}
    lower, upper = ca.DM(low), ca.DM(high)
    # The multipliers of a stage start from those of the following stage in the previous tick.
    rows = {name: row for row, name in enumerate(names)}
    later = [
        rows.get((k + 1, name, i), row) if k + 1 < n else row
        for row, (k, name, i) in enumerate(names)
    ]

    def prepare(tick: Tick) -> Solve:
        if tick.is_first:
            duals.clear()
        plan = mpc.roll(tick.state, tick.guess)
        kappa = np.concatenate([[tick.last], plan.controls[:, 1]])
        points = np.column_stack([plan.states, kappa])
        first = np.concatenate([np.column_stack([points[:-1], plan.controls]).ravel(), points[-1]])
        clearance = np.asarray(tick.risk.clearance, dtype=np.float64).ravel()
        given = ca.DM(np.concatenate([tick.state, [tick.last], tick.risk.frame.origin, clearance]))
        start_from = ca.DM(first)

        def solve() -> NDArray[np.float64] | None:
            found = solver(x0=start_from, p=given, lbg=lower, ubg=upper, **duals)
            if not solver.stats()["success"]:
                duals.clear()
                return None
            lam = np.asarray(found["lam_x"]).ravel()
            duals["lam_x0"] = ca.DM(np.concatenate([lam[7:], lam[-7:]]))
            duals["lam_g0"] = ca.DM(np.asarray(found["lam_g"]).ravel()[later])
            return np.asarray(found["x"]).ravel()[: 7 * n].reshape(n, 7)[:, 5:]

        return solve

    return prepare
