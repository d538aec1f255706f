"""The last resort: a manoeuvre that stops the car within certain cells, kept in every tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Scene
from planner.motion.path import Path
from planner.motion.plan import Plan
from planner.mpc.initial_guess import LOOK, shifted
from planner.mpc.mpc import MPC
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.contact import (
    ANYWHERE,
    ON_COURSE,
    ONWARD,
    Arcs,
    first_free,
    plan_contact,
    swerves,
)
from planner.safety.course import Course, rejoins
from planner.safety.foresight import reveal
from planner.safety.tube import Tube

ACCELERATIONS = 16
"""Number of accelerations, from the plan's own to full braking, tried for the first step."""
ONWARD_SPEED = 0.2
"""Speed below which the car need not be able to go on from the end of a last resort [m/s]: it is
about to stop anyway, and must not stay at rest because of this rule."""
SAME = 1e-3
"""Difference between two accelerations that counts as none [m/s²]."""


class _Demand(NamedTuple):
    """What is demanded of the manoeuvre after a first step.

    Attributes:
        end: where it must end, see `planner.safety.contact`.
        ticks: ticks after the first step at which is foreseen what the car will have seen.
        foreseen_end: where a manoeuvre from these ticks must end.
    """

    end: int
    ticks: tuple[int, ...]
    foreseen_end: int


DEMANDS = (
    # What lies on the plan is about to be seen, so that the manoeuvre will hardly be needed.
    _Demand(ANYWHERE, (2,), ONWARD),
    # It will be seen later. The car may need the manoeuvre, and then has to find back to its path.
    _Demand(ON_COURSE, (2, 4, 7, 11, 16), ON_COURSE),
)
"""Demands, of which a first step has to meet one."""


class _Tests(NamedTuple):
    """What manoeuvres are tested for in a tick.

    Attributes:
        scene: cells that the last resort must not enter, and the body.
        arcs: arcs on which the car may go on.
        course: path that it may follow.
        tube: tube of the manoeuvres.
    """

    scene: Scene
    arcs: Arcs
    course: Course
    tube: Tube


class LastResort:
    """Chooses the first step of a plan together with a manoeuvre that can stop the car after it.

    A plan relies on predictions at the reliance ε. After its first step the next scan may show that
    they are wrong. Then the car must still be able to brake and swerve within certain cells
    (`RiskMap.certain`). At the level λ = 0 only observed cells are certain, and such a manoeuvre
    always exists, by induction: the rest of the last tick's. At λ > 0 cells may also be certain by
    prediction. Then none may exist, because a prediction was wrong or has changed, or the level has
    fallen, and the car may collide.

    The first steps to choose from are the plan's own and slower ones, that of the cautious plan,
    which stays in certain cells itself, and that of the last tick's manoeuvre. The faster of
    the first two is taken, but a step of the plan counts only if the car is expected to be able to
    keep following the plan: braking along it, it must have a manoeuvre in what it will have seen by
    then, until all of the braking lies there. Otherwise the manoeuvre would soon have to be driven,
    wherever it leads. If neither counts, the last tick's manoeuvre is driven on if the car can go
    on from its end, and else the fastest step of the plan that leaves any manoeuvre.

    Args:
        mpc: MPC, which simulates the manoeuvres and holds the car's limits.
        checker: collision checker, which tests them.
        window: side of the square around the car in which a scan changes the map [m].
    """

    def __init__(self, mpc: MPC, checker: CollisionChecker, window: float) -> None:
        self.mpc, self.checker, self.window = mpc, checker, window
        self.controls: NDArray[np.float64] | None = None
        """Controls of the last resort from the next state on, (N, 2); None: none is needed."""
        self._swerves = swerves(mpc.stages, mpc.limits.braking, mpc.limits.max_curvature)

    def secure(
        self,
        state: NDArray[np.float64],
        plan: Plan,
        risk: RiskMap,
        course: Course,
        cautious: Callable[[], Plan | None],
    ) -> tuple[Plan, bool]:
        """Choose what to drive so that a last resort remains after the first step, and keep it.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            plan: plan to drive if all predictions are certain.
            risk: newest risk map around the car.
            course: path that the car should be able to follow after the last resort.
            cautious: function that computes the best plan in certain cells; None if there is none.

        Returns:
            Plan to drive, and whether a last resort remains after its first step.
        """
        braking = self.mpc.limits.braking
        if risk.plan_suffices:
            self.controls = None
            return plan, True
        if self.checker.contact(plan, ~risk.certain, risk.frame) is None:
            self.controls = shifted(plan.controls, braking)
            return plan, True
        tests = _Tests(
            self.checker.body_in(~risk.certain, risk.frame),
            self.checker.arcs_in(risk.barred, risk.frame),
            course,
            self.checker.tube,
        )
        accelerations = np.linspace(plan.controls[0, 0], -braking, ACCELERATIONS)
        firsts = np.column_stack([accelerations, np.full(ACCELERATIONS, plan.controls[0, 1])])
        if state[3] > ONWARD_SPEED:
            first = self._foreseen(state, plan, firsts, risk, tests)
            if first != 0:
                reached = -math.inf if first is None else float(accelerations[first])
                careful = cautious()
                if careful is not None and self._is_better(careful, reached, course):
                    self.controls = shifted(careful.controls, braking)
                    return careful, True
            if first is not None:
                return self._drive(state, plan, firsts, first, tests)
            own = self.controls
            if own is not None and self._first_free(state, own[None], ONWARD, tests) == 0:
                self.controls = shifted(own, braking)
                return self.mpc.roll(state, own), True
        for end in (ONWARD, ANYWHERE) if state[3] > ONWARD_SPEED else (ANYWHERE,):
            first = self._fastest(state, firsts, self.manoeuvres(plan), end, tests)
            if first is not None:
                return self._drive(state, plan, firsts, first, tests)
        braked = self.brake(state, plan, risk)
        return braked, self.checker.contact(braked, ~risk.certain, risk.frame) is None

    def _foreseen(
        self,
        state: NDArray[np.float64],
        plan: Plan,
        firsts: NDArray[np.float64],
        risk: RiskMap,
        tests: _Tests,
    ) -> int | None:
        """Return the fastest first step that meets one of the `DEMANDS`, None if there is none."""
        best: int | None = None
        for demand in DEMANDS:
            first = self._fastest(state, firsts, self.manoeuvres(plan), demand.end, tests)
            if first is None or (best is not None and first >= best):
                continue
            if self._can_follow(state, plan, firsts[first], risk, tests.course, demand):
                best = first
            if best == 0:
                break
        return best

    def _is_better(self, cautious: Plan, reached: float, course: Course) -> bool:
        """Return whether a cautious plan is faster than a first step of another acceleration."""
        return bool(
            cautious.controls[0, 0] > reached + SAME and rejoins(cautious.states[-1], course)
        )

    def _can_follow(
        self,
        state: NDArray[np.float64],
        plan: Plan,
        first: NDArray[np.float64],
        risk: RiskMap,
        course: Course,
        demand: _Demand,
    ) -> bool:
        """Return whether the car is expected to be able to follow a plan on after a first step."""
        mpc, checker = self.mpc, self.checker
        line = Path.through(plan.states[:, :2], "plan")
        after = mpc.roll(state, first[None]).states[1]
        # It brakes along the plan from then on.
        stop = mpc.roll(after, mpc.pursue(after, line, 0, LOOK, 0.0))
        dt, spacing = mpc.config.dt, checker.spacing
        certain, arcs = risk.certain.copy(), checker.arcs_in(risk.barred, risk.frame)
        # Where the lag will have led by then is not foreseen.
        tube = checker.tube.without_lag()
        # At rest it meets something or nothing, so that no tick is beyond the plan's end.
        for tick in (0, *demand.ticks):
            states, controls = stop.states[tick:], stop.controls[tick:]
            if tick:
                x, y = states[0, :2]
                half = 0.5 * self.window
                reveal(certain, risk.barred, risk.safe, *risk.frame.lattice, x, y, half)
            scene = checker.body_in(~certain, risk.frame)
            if plan_contact(states, controls, dt, spacing, scene, tube)[0] < 0.0:
                return True
            if tick:
                rest = np.full((mpc.stages, 2), (-mpc.limits.braking, 0.0))
                rest[: len(controls)] = controls
                manoeuvres = self._completed(rest)
                manoeuvres[:, 0] = rest[0]
                tests = _Tests(scene, arcs, course, tube)
                if self._first_free(states[0], manoeuvres, demand.foreseen_end, tests) < 0:
                    return False
        return False

    def _drive(
        self,
        state: NDArray[np.float64],
        plan: Plan,
        firsts: NDArray[np.float64],
        first: int,
        tests: _Tests,
    ) -> tuple[Plan, bool]:
        """Return the plan with a first step, and keep the best manoeuvre after it."""
        manoeuvres = self.manoeuvres(plan)
        manoeuvres[:, 0] = firsts[first]
        best = -1
        for end in (ON_COURSE, ONWARD, ANYWHERE):
            best = self._first_free(state, manoeuvres, end, tests)
            if best >= 0:
                break
        controls = manoeuvres[best]
        # Not clipped to the limits, so that the car goes on braking after its planned stop, in case
        # it arrives there faster.
        self.controls = shifted(controls, self.mpc.limits.braking)
        return (plan if first == 0 else self.mpc.roll(state, controls)), True

    def _fastest(
        self,
        state: NDArray[np.float64],
        firsts: NDArray[np.float64],
        manoeuvres: NDArray[np.float64],
        end: int,
        tests: _Tests,
    ) -> int | None:
        """Find a large acceleration of the first step that leaves a manoeuvre to stop.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            firsts: controls a, κ of the first step to try, by descending acceleration, (m, 2).
            manoeuvres: controls of the manoeuvres, (n, N, 2); their first steps are overwritten.
            end: where the manoeuvre must end.
            tests: what the manoeuvres are tested for.

        Returns:
            Index of the first step; None if no first step leaves a manoeuvre.
        """

        def leaves_one(first: int) -> bool:
            manoeuvres[:, 0] = firsts[first]
            return self._first_free(state, manoeuvres, end, tests) >= 0

        if leaves_one(0):
            return 0
        too_fast, fastest = 0, len(firsts) - 1
        found = leaves_one(fastest)
        while not found and end == ANYWHERE and too_fast < fastest - 1:
            # Gentler braking may leave a manoeuvre where harder braking leaves none.
            fastest -= 1
            found = leaves_one(fastest)
        if not found:
            return None
        # Bisection between an acceleration that is too high and one that leaves a manoeuvre.
        while fastest - too_fast > 1:
            middle = (fastest + too_fast) // 2
            if leaves_one(middle):
                fastest = middle
            else:
                too_fast = middle
        return fastest

    def _first_free(
        self, state: NDArray[np.float64], manoeuvres: NDArray[np.float64], end: int, tests: _Tests
    ) -> int:
        """Return the index of the first manoeuvre that passes the tests, or -1."""
        dt, limits = self.mpc.config.dt, self.mpc.limits.driving
        scene, arcs, course, tube = tests
        spacing = self.checker.spacing
        return int(
            first_free(state, manoeuvres, dt, limits, spacing, scene, tube, end, arcs, course)
        )

    def brake(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> Plan:
        """Return the least bad manoeuvre to stop, and keep its rest as the last resort."""
        manoeuvres = self.manoeuvres(plan)
        stops = [self.mpc.roll(state, controls) for controls in manoeuvres]
        badness = [self._badness(stop, risk) for stop in stops]
        best = badness.index(min(badness))
        self.controls = shifted(manoeuvres[best], self.mpc.limits.braking)
        return stops[best]

    def manoeuvres(self, plan: Plan) -> NDArray[np.float64]:
        """Return controls of manoeuvres to stop, (n, N, 2).

        They are the last resort of the last tick, braking along a plan, and swerves.
        """
        swerves = self._completed(plan.controls)
        return swerves if self.controls is None else np.concatenate([self.controls[None], swerves])

    def _completed(self, controls: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the swerves; some of them begin with the curvatures of controls (N, 2)."""
        swerves = self._swerves.copy()
        np.copyto(swerves[:, :, 1], controls[:, 1], where=np.isnan(swerves[:, :, 1]))
        return swerves

    def _badness(self, stop: Plan, risk: RiskMap) -> tuple[float, ...]:
        """Return how bad a stop is, as speeds [m/s] of which the first ones matter most.

        They are the speeds at which the body meets cells observed occupied, leaves the safe set,
        leaves the certain cells, and reaches the plan's end; -1 where it never does, since it may
        also meet a cell at rest.
        """
        met = (
            self.checker.contact(stop, blocked, risk.frame)
            for blocked in (risk.known.occupied, ~risk.safe, ~risk.certain)
        )
        hit, left, unsure = (-1.0 if contact is None else contact[1] for contact in met)
        return hit, left, unsure, float(stop.states[-1, 3])
