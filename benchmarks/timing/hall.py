"""The hall that solvers of the MPC's problem are driven through, each in its own closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.motion.path import SPACING, Path
from planner.motion.plan import Plan
from planner.mpc.initial_guess import pursue, shifted
from planner.mpc.mpc import MPC
from planner.navigator import AHEAD
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from predictor.mapping.grid import FREE, OCCUPIED, Grid, GridFrame

SIDE, RESOLUTION = 200, 0.05
"""Of the risk map that a tick reads [cells], and of a cell [m]."""
LENGTH, WIDTH = 40.0, 8.0
"""Of the hall [m]."""
POSTS = 14
"""In it."""
BEHIND = 2.0
"""How far behind the car's start the path begins [m]."""

Solve = Callable[[], NDArray[np.float64] | None]
"""What is timed: controls (N, 2), or None where the solver says that it failed."""


@dataclass(frozen=True, eq=False)
class Tick:
    """What a solver is given.

    Attributes:
        state: x, y, yaw, v, (4,).
        risk: the map around the car.
        guess: first guess of the controls, (N, 2).
        last: curvature of the tick before [1/m].
        is_first: whether a drive begins, and nothing of the last one may be used.
    """

    state: NDArray[np.float64]
    risk: RiskMap
    guess: NDArray[np.float64]
    last: float
    is_first: bool


Solver = Callable[[Tick], Solve]
"""Prepares a solve, with all its input in place."""


def hall(seed: int | None) -> Grid:
    """Return a hall along x with round posts in it, or without for None, all observed."""
    rng = np.random.default_rng(seed)
    shape = (round(WIDTH / RESOLUTION), round((LENGTH + 10) / RESOLUTION))
    frame = GridFrame(RESOLUTION, (-5.0, -WIDTH / 2), shape)
    xs, ys = frame.centres()
    cells = np.full(frame.shape, FREE, dtype=np.int8)
    for _ in range(0 if seed is None else POSTS):
        x, y, radius = rng.uniform(3, LENGTH), rng.uniform(-3, 3), rng.uniform(0.1, 0.5)
        cells[(xs[None] - x) ** 2 + (ys[:, None] - y) ** 2 < radius**2] = OCCUPIED
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return Grid(frame, cells)


def straight(aside: float = 0.0) -> Path:
    """Return the path along the hall's middle, or beside it [m]."""
    return Path.through(np.array([[-BEHIND, aside], [LENGTH + 60.0, aside]]), "given")


def segment_at(x: float) -> int:
    """Return the segment of `straight` near which a car is."""
    return max(0, int((x + BEHIND) / SPACING) - 2)


def pursuit(mpc: MPC, path: Path, state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return controls (N, 2) of a car that pursues a path and ignores the posts."""
    car = mpc.limits
    return np.asarray(
        pursue(
            path.points,
            segment_at(state[0]),
            state,
            mpc.stages,
            mpc.config.dt,
            car.v_max,
            car.acceleration,
            car.braking,
            car.lateral_acceleration,
            car.max_curvature,
            1e6,
        )
    )


def around(grid: Grid, state: NDArray[np.float64]) -> RiskMap:
    """Return the risk map of a tick, placed as in driving."""
    centre = state[:2] + AHEAD * np.array([np.cos(state[2]), np.sin(state[2])])
    frame = grid.frame.square(float(centre[0]), float(centre[1]), SIDE * grid.frame.resolution)
    return RiskMap.from_prediction(grid.crop(frame), None, 0.0)


@dataclass(frozen=True)
class Drive:
    """A solver's closed loop through a hall.

    Attributes:
        cost: of what was driven.
        times: of each solve but the first [ms].
        failures: ticks in which the solver said that it failed; the car went on by its guess.
        hit: whether the car hit a post.
    """

    cost: float
    times: list[float]
    failures: int
    hit: bool


def drive(mpc: MPC, prepare: Solver, seed: int | None, ticks: int) -> Drive:
    """Drive through a hall by a solver."""
    grid, path = hall(seed), straight()
    state, last = np.array([0.0, 0.0, 0.0, 0.0]), 0.0
    guess = pursuit(mpc, path, state)
    states, controls, times, failures = [state], [], [], 0
    for tick in range(ticks):
        solve = prepare(Tick(state, around(grid, state), guess, last, tick == 0))
        started = time.perf_counter()
        found = solve()
        times.append(1e3 * (time.perf_counter() - started))
        failures += found is None
        plan = mpc.roll(state, guess if found is None else found)
        controls.append(plan.controls[0])
        state, last = plan.states[1].copy(), float(plan.controls[0, 1])
        states.append(state)
        guess = shifted(plan.controls, mpc.limits.braking)
    driven = Plan(np.array(states), np.array(controls))
    whole = RiskMap.from_prediction(grid, None, 0.0)
    checker = CollisionChecker(mpc.limits, mpc.config.dt)
    hit = checker.contact(driven, grid.occupied, whole.frame) is not None
    # A drive, unlike a plan, need not end stopped.
    moving = 10.0 * mpc.config.violation * float(driven.states[-1, 3])
    cost = mpc.evaluate(driven, path, whole, segment_at(0.0), 0.0) - moving
    return Drive(cost, times[1:], failures, hit)
