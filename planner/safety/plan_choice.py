"""The choice of a plan: the best one of those that are safe on the newest map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import REST
from foresee.mapping.error_bounds import NO_ERRORS, ErrorBounds
from planner.fault import Fault
from planner.motion.goal import ONWARD_GOAL_RADIUS, PLAN_GOAL_RADIUS
from planner.motion.path import POINT_SPACING, Path, project
from planner.motion.plan import Plan
from planner.mpc.initial_guess import shifted, stop_controls
from planner.mpc.mpc import MPC, MPCConfig
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.last_resort import LastResort
from planner.safety.safe_solver import SafeSolver, moves
from planner.safety.situation import Situation
from planner.safety.tube import EXACT, planned

FRESH_GUESS_SPEED = 0.3
"""Speed below which the MPC always starts from a pure-pursuit guess, too, since the last plan may
stand still [m/s]."""
LEG_LOOK = 0.3
"""Distance of the point on a leg that pure pursuit aims at [m]."""
LEG_STOP = 0.05
"""Distance from a leg's end within which the car stops at once [m], so that it does not creep. The
guide accepts a larger one, `GuideConfig.leg_end`."""
EARLIER_STOPS = (0.5, 1.0, 1.5, 2.0)
"""Distances along the path before the best plan's end at which a stop is tried instead [m]."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A chosen plan.

    Attributes:
        plan: plan to drive.
        intended: plan that the car would drive if all predictions were certain. `plan` differs
            from it if the last resort has to slow the car down.
        faults: faults that were handled, in order; a fault may occur more than once.
    """

    plan: Plan
    intended: Plan
    faults: tuple[Fault, ...]

    @property
    def emergency(self) -> bool:
        """Whether no plan is safe, so that the car brakes as hard as it can."""
        return Fault.EMERGENCY in self.faults


class _Intention(NamedTuple):
    """The plan to drive if all predictions are certain, and the faults that were handled."""

    plan: Plan
    faults: tuple[Fault, ...] = ()


class PlanMemory(NamedTuple):
    """What a `PlanChooser` remembers of the last tick.

    Attributes:
        intended: plan that the car would have driven if all predictions had been certain, or None.
        cautious: plan in the cells that the last resort may enter; None: there was none.
        curvature: curvature of the control [1/m].
        kept: controls of the manoeuvre that stops the car if no decision follows, (N, 2).
        resort: controls of the last resort, (N, 2); None: the plan itself is the last resort.
    """

    intended: Plan | None
    cautious: Plan | None
    curvature: float
    kept: NDArray[np.float64]
    resort: NDArray[np.float64] | None


class PlanChooser:
    """Chooses a plan in every tick, for one gear.

    Candidates are plans of the MPC from several guesses, the rest of the last plan, braking, and
    the last resort. On a leg of a recovery manoeuvre, pure pursuit takes the MPC's place. Each plan
    is tested by the collision checker, whatever the solver reports.

    Args:
        car: the car's limits in that gear, and its body.
        config: settings of the MPC.
        goal: x, y of the goal [m].
        window: side of the square around the car in which a scan changes the map [m].
        bounds: bounds of the errors of sensing and motion.
    """

    def __init__(
        self,
        car: CarLimits,
        config: MPCConfig,
        goal: tuple[float, float],
        window: float,
        bounds: ErrorBounds = NO_ERRORS,
    ) -> None:
        self.goal = goal
        # The MPC's body grows with the tube, see `SafeSolver`.
        self.mpc = MPC(replace(planned(car, bounds), body=car.body), config)
        self.checker = CollisionChecker(car, config.dt)
        self.solver = SafeSolver(self.mpc, self.checker)
        self.resort = LastResort(self.mpc, self.checker, window)
        self._bounded = not (bounds.senses_exactly and bounds.moves_exactly)
        self.forget()

    @property
    def kept(self) -> NDArray[np.float64]:
        """Controls a, κ from the next state on that stop the car if no decision follows, (N, 2)."""
        return self._kept

    def forget(self) -> None:
        """Forget the last plan, since the car has changed its gear or its heading."""
        self._intended: Plan | None = None
        self._last_cautious: Plan | None = None
        self.resort.controls = None
        self._curvature = 0.0
        # A car at rest may stay at rest.
        self._kept = stop_controls(self.mpc.stages, self.mpc.limits.braking, 0.0)

    def memory(self) -> PlanMemory:
        """Return what is remembered of the last tick, for `recall`."""
        # None of them is changed in place.
        return PlanMemory(
            self._intended, self._last_cautious, self._curvature, self._kept, self.resort.controls
        )

    def recall(self, memory: PlanMemory) -> None:
        """Go back to what was remembered when `memory` was called."""
        self._intended, self._last_cautious, self._curvature, self._kept, resort = memory
        self.resort.controls = resort

    def stand(self, state: NDArray[np.float64]) -> Choice:
        """Return the choice to stand, as on a turn on the spot, and forget the last plan.

        Standing is itself the last resort.

        Args:
            state: current x, y, yaw, v of the car, which is at rest, (4,).
        """
        self.forget()
        plan = self.mpc.roll(state, np.zeros((self.mpc.stages, 2)))
        return Choice(plan, plan, ())

    def halt(self, state: NDArray[np.float64]) -> Choice:
        """Return the choice to go on with the manoeuvre that was kept, which stops the car.

        Args:
            state: x, y, yaw, v of the car when the control acts, (4,).
        """
        plan = self._carried_on(state)
        self._keep(plan)
        self._intended, self._curvature = plan, float(plan.controls[0, 1])
        return Choice(plan, plan, ())

    def _carried_on(self, state: NDArray[np.float64]) -> Plan:
        """Return the rest of the manoeuvre that was kept, as the plan and as the last resort."""
        self.resort.controls = shifted(self._kept, self.mpc.limits.braking)
        plan = self.mpc.roll(state, self._kept)
        # The control that was tested: the one that fits the newest estimate may brake less, since a
        # car with a lag still moves where its plan stands.
        return Plan(plan.states, np.vstack([self._kept[:1], plan.controls[1:]]))

    def choose(self, now: Situation, afresh: bool) -> Choice:
        """Choose the plan to drive.

        Args:
            now: situation of the tick.
            afresh: whether the MPC starts from a pure-pursuit guess, too.
        """
        if now.tube != self.checker.tube:
            checker = replace(self.checker, tube=now.tube)
            self.checker = self.solver.checker = self.resort.checker = checker
        intended, faults = self._decide(now, afresh)
        intended = plan = self._without_waiting(now, intended)
        last = None if afresh else self._last_cautious
        self._last_cautious = None
        if Fault.EMERGENCY not in faults:
            course = self.checker.course_on(self._path(now, intended), now.segment, now.risk)
            more = list[Fault]()
            plan, survivable = self.resort.secure(
                now.state, intended, now.risk, course, lambda: self._cautious(now, last, more)
            )
            faults = (*faults, *more)
            if not survivable:
                faults = (*faults, Fault.NO_LAST_RESORT)
        if self._bounded and not {Fault.EMERGENCY, Fault.NO_LAST_RESORT}.isdisjoint(faults):
            # What was kept has been tested for all errors within the bounds, from where the car was
            # then. It remains safe, although the newest estimate does not show it.
            plan = intended = self._carried_on(now.state)
            unsafe = Fault.EMERGENCY, Fault.NO_LAST_RESORT
            faults = (*(fault for fault in faults if fault not in unsafe), Fault.OPEN_LOOP)
        self._keep(plan)
        self._intended, self._curvature = intended, float(plan.controls[0, 1])
        return Choice(plan, intended, faults)

    def skip(self) -> NDArray[np.float64]:
        """Return the control a, κ (2,) of a tick without a choice, and go on to the next one.

        It is the next one of the manoeuvre that was kept in the last tick, which stops the car.
        """
        kept = self._kept
        control = kept[0].copy()
        rest = shifted(kept, self.mpc.limits.braking)
        self._kept, self._last_cautious = rest, None
        self._curvature = float(control[1])
        if self._intended is not None:
            # The next choice leaves out its first step, which is this tick's.
            self._intended = replace(self._intended, controls=kept)
        if self.resort.controls is not None:
            self.resort.controls = rest
        return control

    def _keep(self, plan: Plan) -> None:
        """Keep the manoeuvre that follows the first step of a plan and stops the car."""
        braking = self.mpc.limits.braking
        kept = shifted(plan.controls, braking)
        # A car that is faster than planned brakes on after its planned stop.
        stands = plan.states[1:, 3] < REST
        kept[:-1][stands[:-1] & stands[1:], 0] = -braking
        self._kept = kept if self.resort.controls is None else self.resort.controls

    def goes_on(self, plan: Plan, risk: RiskMap) -> bool:
        """Return whether the car can go on from a plan's end, or need not since the goal is near.

        It can go on if the body meets no barred cell on some arc, or straight on. A plan that
        relies on no prediction is judged by what was observed alone, as without a predictor.
        """
        x, y = plan.states[-1, :2]
        if math.hypot(x - self.goal[0], y - self.goal[1]) < ONWARD_GOAL_RADIUS:
            return True
        relies = self.checker.contact(plan, ~risk.known.free, risk.frame) is not None
        barred = risk.barred if relies else risk.known.occupied
        return self.checker.leads_on(plan.states[-1], barred, risk.frame)

    def _path(self, now: Situation, intended: Plan) -> Path:
        """Return the path to follow; without one, the way of the intended plan."""
        return now.path or Path.through(intended.states[:, :2], "plan")

    def _cautious(self, now: Situation, last: Plan | None, faults: list[Fault]) -> Plan | None:
        """Return a plan in the cells that the last resort may enter, None if there is none.

        It is the plan of a car that knows only these cells.

        Args:
            now: situation of the tick.
            last: the last tick's cautious plan, from whose rest the MPC starts; None: it starts
                from a pure-pursuit guess.
            faults: list to which the faults that were handled are added.
        """
        if now.path is None or now.on_leg:
            return None
        there = replace(now, risk=now.risk.cautious)
        guess = (
            self.solver.pursuit(there, now.path)
            if last is None
            else shifted(last.controls, self.mpc.limits.braking)
        )
        plans, more = self.solver.solutions(there, now.path, [guess], self._curvature)
        faults += more
        self._last_cautious = next(iter(plans), None)
        return self._last_cautious

    def _decide(self, now: Situation, afresh: bool) -> _Intention:
        """Choose the plan to drive if all predictions are certain: the best safe one.

        If none is safe, it is the least bad manoeuvre to stop, with the fault EMERGENCY.
        """
        rest, safe = self._fallbacks(now)
        path = now.path
        if path is None:
            return _Intention(safe[-1]) if safe else self._emergency(now, rest)

        if now.on_leg:
            return self._along_leg(now, path, rest, safe)

        def cost(plan: Plan) -> float:
            return self.mpc.evaluate(plan, path, now.risk, now.segment, self._curvature)

        guesses = [rest.controls]
        if afresh or not safe or now.state[3] < FRESH_GUESS_SPEED:
            guesses.append(self.solver.pursuit(now, path))
        solved, faults = self.solver.solutions(now, path, guesses, self._curvature)
        if not solved:
            faults = (*faults, Fault.NO_SAFE_SOLUTION)
        candidates = sorted(solved + safe, key=cost)
        if not candidates:
            return self._emergency(now, rest, faults)
        # The plan that reaches the goal first, or else the cheapest. The drive ends at the goal, so
        # the cost of what follows must not make the car miss it.
        best = min(candidates, key=self._arrival)
        if now.tube != EXACT and now.state[3] < REST and not moves(best):
            # The circles of the MPC grow more than the body, so that its best plan may be to wait
            # where there is room enough to drive.
            best = next(filter(moves, candidates), best)
        if self.goes_on(best, now.risk):
            return _Intention(best, faults)
        # A car that cannot reverse should not stop with its front against a wall.
        sooner, more = self._stopping_sooner(now, path, best)
        faults += more
        if sooner is not None:
            return _Intention(sooner, faults)
        # Or it brakes and swerves to where it can go on, while there is still room for that.
        stops = (self.mpc.roll(now.state, controls) for controls in self.resort.manoeuvres(best))
        stops = (stop for stop in stops if self.checker.is_safe(stop, now.risk))
        others = [*candidates, *sorted(stops, key=cost)]
        # A plan that stands still is no better than a stop at the wall.
        onward = next(
            (plan for plan in filter(moves, others) if self.goes_on(plan, now.risk)), best
        )
        return _Intention(onward, faults)

    def _emergency(self, now: Situation, rest: Plan, faults: tuple[Fault, ...] = ()) -> _Intention:
        """Return the least bad manoeuvre to stop, since no plan is safe.

        Args:
            now: situation of the tick.
            rest: rest of the last plan.
            faults: faults handled so far in this tick.
        """
        braked = self.resort.brake(now.state, rest, now.risk)
        return _Intention(braked, (*faults, Fault.EMERGENCY))

    def _along_leg(self, now: Situation, leg: Path, rest: Plan, safe: list[Plan]) -> _Intention:
        """Choose the plan that follows a leg of a recovery manoeuvre, as `_decide` does for a path.

        The MPC has no part in it: legs pass closer to walls than it prefers, so it would rather let
        the car wait.
        """
        left = np.vstack([now.state[:2], leg.points[now.segment + 1 :]])
        length = float(np.hypot(*np.diff(left, axis=0).T).sum())
        pursued = self.mpc.roll(now.state, self.solver.pursuit(now, leg, LEG_LOOK, length))
        if self.checker.is_safe(pursued, now.risk):
            safe = [pursued, *safe]
        if not safe:
            return self._emergency(now, rest)
        # The last one brakes at once, unless that is unsafe.
        if math.dist(safe[-1].states[-1, :2], leg.points[-1]) < LEG_STOP:
            return _Intention(safe[-1])
        return _Intention(min(safe, key=lambda plan: self.mpc.lag(plan, leg, now.segment)))

    def _fallbacks(self, now: Situation) -> tuple[Plan, list[Plan]]:
        """Return the rest of the last plan, and the safe ones among the plans that need no solver.

        These are the last resort, the rest of the last plan, and braking, in this order.
        """
        mpc, braking = self.mpc, self.mpc.limits.braking
        stop = mpc.roll(now.state, stop_controls(mpc.stages, braking, self._curvature))
        rest = stop
        if self._intended is not None:
            rest = mpc.roll(now.state, shifted(self._intended.controls, braking))
        plans = [rest, stop]
        if self.resort.controls is not None:
            plans.insert(0, mpc.roll(now.state, self.resort.controls))
        return rest, [plan for plan in plans if self.checker.is_safe(plan, now.risk)]

    def _arrival(self, plan: Plan) -> float:
        """Return the index of a plan's first state at the goal; infinite if there is none."""
        off = np.hypot(*(plan.states[:, :2] - np.array(self.goal)).T)
        reached = np.flatnonzero(off < PLAN_GOAL_RADIUS)
        return float(reached[0]) if len(reached) else math.inf

    def _without_waiting(self, now: Situation, plan: Plan) -> Plan:
        """Return a plan without first steps in which a standing car would wait, if that is safe.

        Otherwise the solver may return, tick after tick, a plan that starts to move only later.
        """
        moving = np.flatnonzero(plan.states[1:, 3] > 1e-3)
        if now.state[3] > 0.0 or not len(moving) or moving[0] == 0:
            return plan
        first = int(moving[0])
        rest = stop_controls(first, self.mpc.limits.braking, float(plan.controls[-1, 1]))
        sooner = self.mpc.roll(now.state, np.vstack([plan.controls[first:], rest]))
        return sooner if self.checker.is_safe(sooner, now.risk) else plan

    def _stopping_sooner(
        self, now: Situation, path: Path, best: Plan
    ) -> tuple[Plan | None, tuple[Fault, ...]]:
        """Find a plan that stops before the best one's end, where the car can go on.

        Returns:
            The plan, or None, and the faults that were handled.
        """
        faults: tuple[Fault, ...] = ()
        end, _, _ = project(path.points, *best.states[-1, :2], now.segment, 10**6)  # type: ignore[call-arg]
        for sooner in EARLIER_STOPS:
            last = end - round(sooner / POINT_SPACING)
            if last < now.segment + 3:
                break
            shorter = Path(path.points[:last], path.source)
            guess = self.solver.pursuit(now, shorter)
            solved, more = self.solver.solutions(now, shorter, [guess], self._curvature)
            faults += more
            for plan in solved:
                if self.goes_on(plan, now.risk):
                    return plan, faults
        return None, faults
