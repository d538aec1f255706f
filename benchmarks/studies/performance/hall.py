"""The hall with posts in which solvers of the MPC's problem drive, each in its own closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from planner.motion.path import POINT_SPACING, Path
from planner.motion.plan import Plan
from planner.mpc.initial_guess import shifted
from planner.mpc.mpc import MPC
from planner.navigator_config import RISK_MAP_AHEAD
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker

MAP_CELLS = 200
"""Side of the risk map of a tick [cells]."""
LENGTH, WIDTH = 40.0, 8.0
"""Length and width of the hall [m]."""
POSTS = 14
"""Number of posts in the hall."""
BEHIND = 2.0
"""Distance from the beginning of the path to the car's start [m]."""

Solve = Callable[[], NDArray[np.float64] | None]
"""Function that is timed; it returns controls (N, 2), or None if the solver reports a failure."""


@dataclass(frozen=True, eq=False)
class Tick:
    """The input of a solver in one tick.

    Attributes:
        state: x, y [m], yaw [rad], v [m/s], (4,).
        risk: risk map around the car.
        guess: first guess of the controls, (N, 2).
        last: curvature in the previous tick [1/m].
        is_first: whether this is the first tick of a drive, so that the solver must not reuse
            anything of its last solution.
    """

    state: NDArray[np.float64]
    risk: RiskMap
    guess: NDArray[np.float64]
    last: float
    is_first: bool


Solver = Callable[[Tick], Solve]
"""Function that prepares the input of a solver, and returns the function to be timed."""


def hall(seed: int | None) -> Grid:
    """Return the map of a hall along x with random round posts; without any if the seed is None."""
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
    """Return the straight path along the middle of the hall, or parallel to it.

    Args:
        aside: distance from the middle [m].
    """
    return Path.through(np.array([[-BEHIND, aside], [LENGTH + 60.0, aside]]), "given")


def segment_at(x: float) -> int:
    """Return the number of the segment of `straight` near which a car at `x` [m] is."""
    return max(0, int((x + BEHIND) / POINT_SPACING) - 2)


def around(grid: Grid, state: NDArray[np.float64]) -> RiskMap:
    """Return the risk map around a car, at the same place as in normal driving."""
    centre = state[:2] + RISK_MAP_AHEAD * np.array([np.cos(state[2]), np.sin(state[2])])
    frame = grid.frame.square(float(centre[0]), float(centre[1]), MAP_CELLS * grid.frame.resolution)
    return RiskMap.from_prediction(grid.crop(frame), None, 0.0)


@dataclass(frozen=True)
class HallDrive:
    """The closed loop of a solver through a hall.

    Attributes:
        cost: cost of the drive according to the MPC.
        times: time of each solve except for the first one [ms].
        failures: number of ticks in which the solver reported a failure, so that the car used the
            guess.
        hit: whether the car hit a post.
    """

    cost: float
    times: list[float]
    failures: int
    hit: bool


def drive(mpc: MPC, prepare: Solver, seed: int | None, ticks: int) -> HallDrive:
    """Drive through a hall with a solver in closed loop.

    Args:
        mpc: MPC whose problem is solved.
        prepare: the solver.
        seed: seed of the posts; None: no posts.
        ticks: number of ticks.
    """
    grid, path = hall(seed), straight()
    state, last = np.array([0.0, 0.0, 0.0, 0.0]), 0.0
    guess = mpc.pursue(state, path, segment_at(state[0]))
    states, controls, times, failures = [state], [], [], 0
    for tick in range(ticks):
        solve = prepare(Tick(state, around(grid, state), guess, last, tick == 0))
        started = time.perf_counter()
        solution = solve()
        times.append(1e3 * (time.perf_counter() - started))
        failures += solution is None
        plan = mpc.roll(state, guess if solution is None else solution)
        controls.append(plan.controls[0])
        state, last = plan.states[1].copy(), float(plan.controls[0, 1])
        states.append(state)
        guess = shifted(plan.controls, mpc.limits.braking)
    driven = Plan(np.array(states), np.array(controls))
    whole = RiskMap.from_prediction(grid, None, 0.0)
    checker = CollisionChecker(mpc.limits, mpc.config.dt)
    hit = checker.contact(driven, grid.occupied, whole.frame) is not None
    # The penalty for not being stopped at the end is removed: it applies to plans, not to drives.
    moving = 10.0 * mpc.config.violation * float(driven.states[-1, 3])
    cost = mpc.evaluate(driven, path, whole, segment_at(0.0), 0.0) - moving
    return HallDrive(cost, times[1:], failures, hit)
