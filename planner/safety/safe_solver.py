"""The MPC's plans that are safe: each is tested cell by cell, whatever the solver reports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.fault import Fault
from planner.motion.path import Path
from planner.motion.plan import Plan
from planner.mpc.initial_guess import LOOK
from planner.mpc.mpc import MPC, Solution
from planner.safety.collision import CollisionChecker
from planner.safety.situation import Situation
from planner.safety.tube import EXACT, growth

STANDS_STILL = 0.1
"""A plan that ends within this distance of its start counts as standing still [m]."""
TUBES = 3
"""Number of times that a plan is computed, each time with the tube of the one before."""
START_STEPS = (8, 5, 3)
"""Numbers of steps that a car may drive before it brakes if it would wait otherwise."""


class Solutions(NamedTuple):
    """The safe plans that the MPC found, and the faults that were handled."""

    plans: list[Plan]
    faults: tuple[Fault, ...]


class SafeSolver:
    """Computes plans by the MPC, and keeps the safe ones.

    Args:
        mpc: MPC.
        checker: collision checker, which tests the plans.
    """

    def __init__(self, mpc: MPC, checker: CollisionChecker) -> None:
        self.mpc, self.checker = mpc, checker

    def solutions(
        self,
        now: Situation,
        path: Path,
        guesses: list[NDArray[np.float64]],
        curvature: float,
    ) -> Solutions:
        """Return the safe ones among the plans that the MPC computes from some guesses.

        Args:
            now: situation of the tick.
            path: path to follow.
            guesses: controls from which the MPC starts, (N, 2) each.
            curvature: curvature of the last tick's control [1/m].
        """
        solved, faults = list[Plan](), list[Fault]()
        for guess in guesses:
            try:
                solution = self._solution(now, path, guess, curvature)
            except Exception:
                # A solver may raise anything; there is another plan, or the car stops.
                faults.append(Fault.SOLVER_FAILED)
                continue
            if solution.failed:
                faults.append(Fault.SOLVER_FAILED)
            if self.checker.is_safe(solution.plan, now.risk):
                solved.append(solution.plan)
        if now.tube != EXACT and not any(map(moves, solved)):
            # The MPC knows the tube only from plan to plan; a guess may stay inside the safe set.
            starts = (start for guess in guesses for start in self._starts(guess))
            rolled = (self.mpc.roll(now.state, guess) for guess in (*guesses, *starts))
            solved += [plan for plan in rolled if self.checker.is_safe(plan, now.risk)]
        return Solutions(solved, tuple(faults))

    def _starts(self, guess: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
        """Yield the first steps of a guess, after which the car brakes: their tube is narrow."""
        for steps in START_STEPS:
            start = guess.copy()
            start[steps:] = -self.mpc.limits.braking, guess[steps - 1, 1]
            yield start

    def _solution(
        self, now: Situation, path: Path, guess: NDArray[np.float64], curvature: float
    ) -> Solution:
        """Return the MPC's plan from a guess, which keeps its tube in the safe set if possible.

        The tube of a plan is known only with the plan: it is that of the guess at first.
        """
        if now.tube != EXACT:
            self.mpc.growth = self._growth(now, self.mpc.roll(now.state, guess))
        for again in range(TUBES):
            solution = self.mpc.solve(now.state, path, now.risk, guess, now.segment, curvature)
            plan = solution.plan
            if now.tube == EXACT or again == TUBES - 1 or self.checker.is_safe(plan, now.risk):
                break
            self.mpc.growth = np.maximum(self.mpc.growth, self._growth(now, plan))
            guess = plan.controls
        return solution

    def _growth(self, now: Situation, plan: Plan) -> NDArray[np.float64]:
        """Return how much the circles of the MPC grow with a plan's tube [m], (N+1,)."""
        # The corners of a body that grows on every side move out diagonally.
        dt = self.mpc.config.dt
        return math.sqrt(2.0) * np.asarray(growth(now.tube, plan.states, plan.controls, dt))

    def pursuit(
        self, now: Situation, path: Path, look: float = LOOK, free: float = math.inf
    ) -> NDArray[np.float64]:
        """Return pure-pursuit controls (N, 2) along a path, which stop before an unsafe cell.

        Args:
            now: situation of the tick.
            path: path to follow.
            look: distance of the point to aim at, at least [m].
            free: distance within which the car is to stop [m].
        """
        controls = np.zeros((self.mpc.stages, 2))
        for _ in range(2):
            controls = self.mpc.pursue(now.state, path, now.segment, look, free)
            rolled = self.mpc.roll(now.state, controls)
            met = self.checker.contact(rolled, ~now.risk.safe, now.risk.frame)
            if met is None:
                break
            free = min(free, max(met[0] - 0.1, 0.0))
        return controls


def moves(plan: Plan) -> bool:
    """Return whether a plan does not stand still."""
    return math.dist(*plan.states[[0, -1], :2]) > STANDS_STILL
