"""Peers of the MPC: general solvers in casadi (IPOPT, fatrop), on the whole sparse problem.

Dynamics, costs and limits are those of `planner.mpc.mpc`, along the path through the middle of the
hall. Parts of the problem are functions of scalar symbols (SX), which casadi evaluates and
differentiates several times as fast as matrix symbols (MX). The latter only call these functions
and read the map.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.hall import BEHIND, MAP_CELLS, Solve, Solver, Tick
from foresee.mapping.conventions import RESOLUTION
from planner.mpc.mpc import MPC

IPOPT = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-4,
    "ipopt.mu_init": 1e-3,
    "ipopt.warm_start_init_point": "yes",
}
"""Settings with which IPOPT is fastest here."""
FATROP = {
    "fatrop.print_level": 0,
    "fatrop.tol": 1e-4,
    "fatrop.mu_init": 1e-3,
    "structure_detection": "auto",
}
"""Settings with which fatrop is fastest here."""
COMPILED = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
"""Settings with which casadi writes the problem's functions as C and compiles them with gcc."""
X, U = ca.SX.sym("x", 5), ca.SX.sym("u", 2)
"""Symbols of a stage: x, y, yaw, v and the curvature of the previous step, (5,); control (2,). With
the previous curvature in the state, no cost depends on two stages."""


def general(mpc: MPC, plugin: str, compiled: bool) -> Solver:
    """Return a solver that starts from its own last solution, including the multipliers.

    Args:
        mpc: MPC whose problem is solved.
        plugin: "ipopt" or "fatrop".
        compiled: whether the problem's functions are compiled to machine code.
    """
    n = mpc.stages
    nlp, rows = _problem(mpc)
    low, high = (np.concatenate([row[bound] for row in rows]) for bound in ("low", "high"))
    options: dict[str, Any] = {"print_time": False, "calc_lam_p": False}
    options |= IPOPT if plugin == "ipopt" else FATROP | {"equality": (low == high).tolist()}
    solver = ca.nlpsol("solver", plugin, nlp, options | (COMPILED if compiled else {}))
    duals: dict[str, Any] = {}
    lower, upper = ca.DM(low), ca.DM(high)
    # The multipliers of a stage start from those of the following stage in the previous tick.
    names = [(row["stage"], row["name"], i) for row in rows for i in range(len(row["low"]))]
    numbers = {name: number for number, name in enumerate(names)}
    later = [
        numbers.get((k + 1, name, i), number) if k + 1 < n else number
        for number, (k, name, i) in enumerate(names)
    ]

    def prepare(tick: Tick) -> Solve:
        if tick.is_first:
            duals.clear()
        plan = mpc.roll(tick.state, tick.guess)
        curvature = np.concatenate([[tick.last], plan.controls[:, 1]])
        states = np.column_stack([plan.states, curvature])
        guess = np.concatenate([np.column_stack([states[:-1], plan.controls]).ravel(), states[-1]])
        clearance = np.asarray(tick.risk.clearance, dtype=np.float64).ravel()
        given = ca.DM(np.concatenate([tick.state, [tick.last], tick.risk.frame.origin, clearance]))
        first = ca.DM(guess)

        def solve() -> NDArray[np.float64] | None:
            solution = solver(x0=first, p=given, lbg=lower, ubg=upper, **duals)
            if not solver.stats()["success"]:
                duals.clear()
                return None
            lam = np.asarray(solution["lam_x"]).ravel()
            duals["lam_x0"] = ca.DM(np.concatenate([lam[7:], lam[-7:]]))
            duals["lam_g0"] = ca.DM(np.asarray(solution["lam_g"]).ravel()[later])
            return np.asarray(solution["x"]).ravel()[: 7 * n].reshape(n, 7)[:, 5:]

        return solve

    return prepare


def _problem(mpc: MPC) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the nonlinear program, and the rows of its constraints.

    A row has the number of its `stage`, a `name`, and the bounds `low` and `high`, (n,) each. The
    parameters are the first state (5,), the map's origin (2,) and the clearance of its cells.
    """
    n, car = mpc.stages, mpc.limits
    xs = [ca.MX.sym(f"x{k}", 5) for k in range(n + 1)]
    us = [ca.MX.sym(f"u{k}", 2) for k in range(n)]
    start, field = ca.MX.sym("start", 7), ca.MX.sym("field", MAP_CELLS**2)
    step, effort, standing, ending, closeness = _stage_functions(mpc)
    clearances = clearance_function(mpc)
    cost: Any = 0
    values: list[Any] = []
    rows: list[dict[str, Any]] = []

    def constrain(k: int, name: str, value: Any, low: list[float], high: list[float]) -> None:
        values.append(value)
        rows.append({"stage": k, "name": name, "low": low, "high": high})

    for k, x in enumerate(xs):
        if k < n:
            after, lateral = step(x, us[k])
            constrain(k, "step", xs[k + 1] - after, [0.0] * 5, [0.0] * 5)
        if k == 0:
            constrain(k, "start", x - start[:5], [0.0] * 5, [0.0] * 5)
        if k < n:
            limit, curvature = car.planned_cornering, car.max_curvature
            constrain(k, "lateral", lateral, [-limit] * 2, [limit] * 2)
            low, high = [-car.braking, -curvature], [car.acceleration, curvature]
            constrain(k, "control", us[k], low, high)
            cost += effort(x, us[k])
        constrain(k, "speed", x[3], [0.0], [car.v_max if k < n else 0.0])
        if k > 0:
            clear = clearances(x, start[5:], field)
            cost += closeness(clear)
            cost += standing(x) if k < n else ending(x)
            if mpc.required > 0.0:
                constrain(k, "inside", clear, [mpc.required] * 2, [np.inf] * 2)
    variables = [symbol for pair in zip(xs, us, strict=False) for symbol in pair] + [xs[n]]
    nlp = {
        "x": ca.vertcat(*variables),
        "p": ca.vertcat(start, field),
        "f": cost,
        "g": ca.vertcat(*values),
    }
    return nlp, rows


def _stage_functions(mpc: MPC) -> tuple[ca.Function, ...]:
    """Return the functions of a stage, except for those that read the map.

    They are the next state (5,) and the lateral accelerations at both ends of the step (2,); the
    cost of the control; the cost of a state, which is distance from the path less progress along
    it; the cost of the last state; and the cost of small clearances (2,).
    """
    c, dt, (offset, heading) = mpc.config, mpc.config.dt, mpc.config.final
    s = X[3] * dt + U[0] * dt**2 / 2
    half = U[1] * s / 2
    chord = s * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
    speed = X[3] + U[0] * dt
    after = ca.vertcat(
        X[0] + chord * ca.cos(X[2] + half),
        X[1] + chord * ca.sin(X[2] + half),
        X[2] + U[1] * s,
        speed,
        U[1],
    )
    lateral = ca.vertcat(X[3] ** 2 * U[1], speed**2 * U[1])
    effort = c.effort[0] * U[0] ** 2 + c.effort[1] * U[1] ** 2 + c.smoothness * (U[1] - X[4]) ** 2
    standing, ending = (
        -c.progress * (X[0] + BEHIND) + 0.5 * weight * X[1] ** 2 for weight in (c.contour, offset)
    )
    clearances = ca.SX.sym("clearances", 2)
    lacking = ca.fmax(0, mpc.required + c.comfort - clearances)
    return (
        ca.Function("step", [X, U], [after, lateral]),
        ca.Function("effort", [X, U], [effort]),
        ca.Function("standing", [X], [standing]),
        ca.Function("ending", [X], [ending + heading * (1 - ca.cos(X[2]))]),
        ca.Function("closeness", [clearances], [0.5 * c.closeness * ca.sumsqr(lacking)]),
    )


def clearance_function(mpc: MPC) -> Any:
    """Return a function that computes the clearances of the body's two circles, (2,) [m].

    Its arguments are the state (5,), the lower-left corner of the map (2,) [m], and the clearance
    of each cell of the map, row by row, (`MAP_CELLS`²,) [m]. The clearances are interpolated by
    cubic convolution, as in `planner.mpc.clearance.clearances`.
    """
    origin, offset = ca.SX.sym("origin", 2), mpc.limits.body.length / 4
    cells: list[Any] = []
    fractions: list[Any] = []
    for side in (1.0, -1.0):
        ahead = side * offset * ca.vertcat(ca.cos(X[2]), ca.sin(X[2]))
        at = ca.fmin(ca.fmax((X[:2] + ahead - origin) / RESOLUTION - 0.5, 1.0), MAP_CELLS - 2.001)
        first = ca.floor(at)
        fractions.append(at - first)
        cells += [
            (first[1] - 1 + i) * MAP_CELLS + first[0] - 1 + j for i in range(4) for j in range(4)
        ]
    places = [ca.vertcat(*cells), ca.vertcat(*fractions)]
    smooth = {"is_diff_in": [True, False], "is_diff_out": [False, True]}
    place = ca.Function("place", [X, origin], places, smooth)
    patch, t = ca.SX.sym("patch", 32), ca.SX.sym("t", 4)
    read = [
        ca.mtimes([_keys(t[2 * i]).T, ca.reshape(values, 4, 4), _keys(t[2 * i + 1])])
        for i, values in enumerate(ca.vertsplit(patch, 16))
    ]
    cubic = ca.Function("cubic", [patch, t], [ca.vertcat(*read)], {"is_diff_in": [False, True]})

    def clearances(x: Any, origin: Any, field: Any) -> Any:
        around, fraction = place(x, origin)
        return cubic(field[around], fraction)

    return clearances


def _keys(t: Any) -> Any:
    """Return the weights of four neighbours in cubic convolution at a fraction `t`, (4,)."""
    return ca.vertcat(
        ((-0.5 * t + 1) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1,
        ((-1.5 * t + 2) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
