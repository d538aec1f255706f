"""The MPC beside general solvers: the same problem, and each solver's own closed loop.

The problem is that of `planner.mpc` along a straight path through a hall with posts, its body kept
off by cost alone: the constraint that the solvers would treat differently is left out. They get
the exact derivatives of the same expressions, start from their own last solution, and may be
compiled.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.guess import pursue, shifted
from planner.mpc import MPC, MPCConfig, Plan
from planner.reference import Path
from planner.risk import RiskMap
from predictor.grid import FREE, OCCUPIED, Grid, GridFrame

SIDE = 200
"""Of the risk map that a tick reads [cells]."""
COST_ONLY = MPCConfig(margin=-5.0, comfort=5.3, closeness=4.0)
"""Nothing is required of the clearance, and it costs up to where it does in driving."""
LENGTH, WIDTH = 40.0, 8.0
"""Of the hall [m]."""

Solve = Callable[[], NDArray[np.float64] | None]
"""What is timed: controls (N, 2), or None where the solver says that it failed."""
Solver = Callable[[NDArray[np.float64], RiskMap, NDArray[np.float64], float, bool], Solve]
"""From state, risk map, first guess of the controls (N, 2), last curvature, and whether this is a
drive's first tick, to a solve with all its input in place."""


def hall(seed: int) -> Grid:
    """A hall along x with round posts in it, all of it seen."""
    rng = np.random.default_rng(seed)
    frame = GridFrame(0.05, (-5.0, -WIDTH / 2), (round(WIDTH / 0.05), round((LENGTH + 10) / 0.05)))
    xs, ys = frame.centres()
    cells = np.full(frame.shape, FREE, dtype=np.int8)
    for _ in range(14):
        x, y, radius = rng.uniform(3, LENGTH), rng.uniform(-3, 3), rng.uniform(0.1, 0.5)
        cells[(xs[None] - x) ** 2 + (ys[:, None] - y) ** 2 < radius**2] = OCCUPIED
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return Grid(frame, cells)


def straight() -> Path:
    """The path along the hall's middle."""
    return Path.through(np.array([[-2.0, 0.0], [LENGTH + 60.0, 0.0]]), "given")


def ours(mpc: MPC) -> Solver:
    """`planner.mpc`, from one guess."""
    path = straight()

    def prepare(
        state: NDArray[np.float64], risk: RiskMap, guess: NDArray[np.float64], last: float, _: bool
    ) -> Solve:
        segment = max(0, int((state[0] + 2.0) / 0.1) - 2)
        return lambda: mpc.solve(state, path, risk, guess, segment, last).controls

    return prepare


def general(mpc: MPC, plugin: str, compiled: bool) -> Solver:
    """A solver of casadi's on the whole sparse problem, warm-started.

    Args:
        mpc: whose settings and limits count.
        plugin: "ipopt" or "fatrop".
        compiled: whether the problem's functions are compiled to machine code.
    """
    n, car, c = mpc.stages, mpc.limits, mpc.config
    # κ of the step before is part of the state, so that no cost couples more than a stage.
    xs = [ca.MX.sym(f"x{k}", 5) for k in range(n + 1)]
    us = [ca.MX.sym(f"u{k}", 2) for k in range(n)]
    start, field = ca.MX.sym("start", 7), ca.MX.sym("field", SIDE * SIDE)
    cost: Any = 0
    g: list[Any] = []
    low: list[float] = []
    high: list[float] = []
    equal: list[bool] = []

    def constrain(value: Any, lower: list[float], upper: list[float]) -> None:
        g.append(value)
        low.extend(lower)
        high.extend(upper)
        equal.extend(a == b for a, b in zip(lower, upper, strict=True))

    for k in range(n):
        x, u = xs[k], us[k]
        s = x[3] * c.dt + u[0] * c.dt**2 / 2
        half = u[1] * s / 2
        chord = s * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
        after = ca.vertcat(x[0] + chord * ca.cos(x[2] + half), x[1] + chord * ca.sin(x[2] + half),
                           x[2] + u[1] * s, x[3] + u[0] * c.dt, u[1])  # fmt: skip
        constrain(xs[k + 1] - after, [0.0] * 5, [0.0] * 5)
        if k == 0:
            constrain(x - start[:5], [0.0] * 5, [0.0] * 5)
        lateral = 0.99 * car.lateral_acceleration
        constrain(ca.vertcat(x[3] ** 2 * u[1], (x[3] + u[0] * c.dt) ** 2 * u[1]),
                  [-lateral] * 2, [lateral] * 2)  # fmt: skip
        constrain(u, [-car.braking, -car.max_curvature], [car.acceleration, car.max_curvature])
        constrain(x[3], [0.0], [car.v_max])
        cost += c.effort[0] * u[0] ** 2 + c.effort[1] * u[1] ** 2
        cost += c.smoothness * (u[1] - x[4]) ** 2
    constrain(xs[n][3], [0.0], [0.0])
    for k in range(1, n + 1):
        x = xs[k]
        weight = c.final[0] if k == n else c.contour
        cost += -c.progress * (x[0] + 2.0) + 0.5 * weight * x[1] ** 2
        for side in (1.0, -1.0):
            px = x[0] + side * mpc.limits.body.length / 4 * ca.cos(x[2])
            py = x[1] + side * mpc.limits.body.length / 4 * ca.sin(x[2])
            value = _cubic(field, (px - start[5]) / 0.05 - 0.5, (py - start[6]) / 0.05 - 0.5)
            lacking = ca.fmax(0, mpc.required + c.comfort - value)
            cost += 0.5 * c.closeness * lacking**2
    cost += c.final[1] * (1 - ca.cos(xs[n][2]))
    variables = [v for k in range(n) for v in (xs[k], us[k])] + [xs[n]]
    options: dict[str, Any] = {"print_time": False, "calc_lam_p": False}
    if plugin == "ipopt":
        options |= {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-4,
                    "ipopt.mu_init": 1e-3, "ipopt.warm_start_init_point": "yes"}  # fmt: skip
    else:
        options |= {"fatrop.print_level": 0, "structure_detection": "auto", "equality": equal,
                    "fatrop.tol": 1e-4, "fatrop.mu_init": 1e-3}  # fmt: skip
    if compiled:
        options |= {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
    problem = {"x": ca.vertcat(*variables), "p": ca.vertcat(start, field), "f": cost,
               "g": ca.vertcat(*g)}  # fmt: skip
    solver = ca.nlpsol("solver", plugin, problem, options)
    duals: dict[str, Any] = {}
    lower, upper = ca.DM(low), ca.DM(high)
    # The multipliers of a stage start from those that the next one had a tick ago.
    # 10 rows a stage, 5 more at the first for the start, 1 at the end.
    rows = np.arange(len(low))
    later = np.concatenate([rows[15:20], rows[5:10], rows[20:-1], rows[-11:]])

    def prepare(
        state: NDArray[np.float64], risk: RiskMap, guess: NDArray[np.float64], last: float,
        is_first: bool,
    ) -> Solve:  # fmt: skip
        if is_first:
            duals.clear()
        plan = mpc.roll(state, guess)
        kappa = np.concatenate([[last], plan.controls[:, 1]])
        points = np.column_stack([plan.states, kappa])
        first = np.concatenate([np.column_stack([points[:-1], plan.controls]).ravel(), points[-1]])
        clearance = np.asarray(risk.clearance, dtype=np.float64).ravel()
        given = ca.DM(np.concatenate([state, [last], risk.frame.origin, clearance]))
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


@dataclass(frozen=True)
class Drive:
    """A solver's closed loop through a hall.

    Attributes:
        cost: of what was driven.
        times: of each solve but the first [ms].
        failures: solves that failed by the solver's own word; the car went on by its guess.
        hit: whether the car hit a post.
    """

    cost: float
    times: list[float]
    failures: int
    hit: bool


def drive(mpc: MPC, prepare: Solver, seed: int, ticks: int) -> Drive:
    """Drive through a hall by a solver."""
    grid, path, car = hall(seed), straight(), mpc.limits
    state, last = np.array([0.0, 0.0, 0.0, 0.0]), 0.0
    guess = pursue(path.points, 20, state, mpc.stages, mpc.config.dt, car.v_max, car.acceleration,
                   car.braking, car.lateral_acceleration, car.max_curvature, 1e6)  # fmt: skip
    states, controls, times, failures = [state], [], [], 0
    for tick in range(ticks):
        solve = prepare(state, _around(grid, state), guess, last, tick == 0)
        started = time.perf_counter()
        found = solve()
        times.append(1e3 * (time.perf_counter() - started))
        failures += found is None
        plan = mpc.roll(state, guess if found is None else found)
        controls.append(plan.controls[0])
        state, last = plan.states[1].copy(), float(plan.controls[0, 1])
        states.append(state)
        guess = shifted(plan.controls, car.braking)
    driven = Plan(np.array(states), np.array(controls), 0.0, plan.status, 0)
    whole = RiskMap.from_prediction(grid, None, 0.0)
    hit = mpc.contact(driven, grid.occupied, whole) is not None
    # A drive, unlike a plan, need not end stopped.
    moving = 10.0 * mpc.config.violation * float(driven.states[-1, 3])
    cost = mpc.evaluate(driven, path, whole, 18, 0.0) - moving
    return Drive(cost, times[1:], failures, hit)


def _around(grid: Grid, state: NDArray[np.float64]) -> RiskMap:
    """The risk map of a tick, its centre 2.5 m ahead of the car."""
    centre = state[:2] + 2.5 * np.array([np.cos(state[2]), np.sin(state[2])])
    frame = grid.frame.square(float(centre[0]), float(centre[1]), SIDE * grid.frame.resolution)
    return RiskMap.from_prediction(grid.crop(frame), None, 0.0)


def compare(worlds: int, ticks: int, report: Callable[[str], None]) -> dict[str, dict[str, float]]:
    """Each solver's closed loop through the same halls, one hall after the other.

    Args:
        worlds: halls.
        ticks: of each drive.
        report: told what is being done.

    Returns:
        Name → median_ms, p99_ms and ratio (its median over ours) of a solve; cost: of its drives,
        summed; dearer_percent: than ours, the mean over halls; hits: drives that hit a post;
        failures: solves that failed by the solver's own word.
    """
    mpc = MPC(config=COST_ONLY)
    solvers = {"ours": ours(mpc)}
    # casadi leaves what it compiles in the working directory, and needs it there.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, plugin, compiled in (
            ("IPOPT", "ipopt", False),
            ("IPOPT, compiled", "ipopt", True),
            ("fatrop, compiled", "fatrop", True),
        ):
            report(f"making {name}" + (", which takes minutes" if compiled else ""))
            solvers[name] = general(mpc, plugin, compiled)
        drives: dict[str, list[Drive]] = {name: [] for name in solvers}
        for seed in range(worlds):
            for name, solver in solvers.items():
                report(f"{name} in hall {seed + 1} of {worlds}")
                drives[name].append(drive(mpc, solver, seed, ticks))
    times = {name: [t for d in ds for t in d.times] for name, ds in drives.items()}
    ours_ms = float(np.median(times["ours"]))
    reference = np.array([d.cost for d in drives["ours"]])
    compared = {}
    for name, ds in drives.items():
        costs = np.array([d.cost for d in ds])
        median = float(np.median(times[name]))
        compared[name] = {
            "median_ms": median,
            "p99_ms": float(np.percentile(times[name], 99)),
            "ratio": median / ours_ms,
            "cost": float(costs.sum()),
            "dearer_percent": float(100 * ((costs - reference) / abs(reference)).mean()),
            "hits": float(sum(d.hit for d in ds)),
            "failures": float(sum(d.failures for d in ds)),
        }
    return compared
