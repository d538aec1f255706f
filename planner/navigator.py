"""The navigator: turn a LIDAR scan into a control of the car, in each tick."""

from __future__ import annotations

import math
import time
from collections import Counter
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.frontiers import FrontierPredictor
from foresee.infra.float_errors import usual_float_errors
from foresee.mapping.control import Control
from foresee.mapping.conventions import GOAL_RADIUS, REST
from foresee.mapping.error_bounds import NO_ERRORS
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan
from foresee.prediction import Prediction, Predictor, View
from planner.decision import Decision
from planner.fault import Fault
from planner.guide.guide import Guide, Leg
from planner.motion.plan import mirrored
from planner.mpc.initial_guess import shifted
from planner.navigator_config import RISK_MAP_AHEAD, NavigatorConfig
from planner.risk.adaptive_level import AdaptiveLevel
from planner.risk.ask_predictor import FIRST_DEADLINE, Asker
from planner.risk.newest_prediction import NewestPrediction
from planner.risk.predictor_process import PredictorProcess
from planner.risk.risk_map import RiskMap
from planner.safety.collision import swept_cells
from planner.safety.limiting_factor import Limit, what_limits
from planner.safety.plan_choice import Choice, PlanChooser, PlanMemory
from planner.safety.sent_controls import SentControls
from planner.safety.situation import Situation
from planner.safety.tube import planned

WAYPOINT_SIDE = 5.0
"""Side of the square around each waypoint that the map covers from the start [m]."""
REST_TICKS = 4
"""Number of ticks at rest after which a car searches for a recovery manoeuvre, and again each time
as many have passed."""
LINGER_TICKS = 15
"""The same number for ticks within 0.1 m, since a stuck car may start and brake repeatedly."""
FRESH_GUESS_TICKS = 5
"""Number of ticks after which the MPC also starts from a pure-pursuit guess, in normal driving."""


class Navigator:
    """Drives a car to a goal through a building that it has never seen.

    Args:
        config: settings.
        predictor: predicts the map beyond what has been seen; None: no predictions. It runs in a
            thread, or in its own process if it is a `PredictorProcess`; an `Asker` asks it as it
            is.
        start: x, y, yaw of the car at the start, (3,) or more [m, m, rad].
        goal: x, y of the goal [m].
        known: occupancy grid at the start; the navigator adds the scans to it.
        waypoints: points of a prescribed route, (n, 2) [m], the last of them within `GOAL_RADIUS`
            of the goal; None: the car finds its own route.
        seed: seed of the path search.
        frontiers: predictor of frontiers, which changes a route that is not prescribed, or None.
        executor: runs the path searches beside `step`, one at a time, so that `step` never waits
            for one; a `planner.guide.search_process.SearchProcess`, for example. None: they run at
            the end of `step`, so that drives do not depend on any clock.

    Raises:
        ValueError: if there are waypoints of another shape, or none at all, or the last of them is
            not at the goal, or if start, goal or a waypoint is not finite.
    """

    @usual_float_errors()
    def __init__(
        self,
        config: NavigatorConfig,
        predictor: Predictor | Asker | None,
        start: NDArray[np.float64],
        goal: tuple[float, float],
        known: OccupancyGrid,
        waypoints: NDArray[np.float64] | None = None,
        seed: int = 0,
        frontiers: FrontierPredictor | None = None,
        executor: Executor | None = None,
    ) -> None:
        if waypoints is not None and not (
            waypoints.ndim == 2 and waypoints.shape[1] == 2 and waypoints.size
        ):
            raise ValueError(f"waypoints are of shape {waypoints.shape}, not (n, 2) with n > 0")
        for name, value in ("start", start), ("goal", goal), ("waypoints", waypoints):
            if value is not None and not np.isfinite(value).all():
                raise ValueError(f"{name} is {value}, it must be finite")
        if waypoints is not None and (off := math.dist(waypoints[-1], goal)) > GOAL_RADIUS:
            raise ValueError(
                f"the last waypoint is {off:.2f} m from the goal, it may be {GOAL_RADIUS} m at most"
            )
        self.config, self.goal, self.known = config, goal, known
        car, bounds = config.car, config.bounds
        self._choosers = {1: PlanChooser(car, config.mpc, goal, config.window, bounds)}
        if car.reverse > 0.0:
            backwards = replace(car, v_max=car.reverse)
            self._choosers[-1] = PlanChooser(backwards, config.mpc, goal, config.window, bounds)
        self.chooser = self._choosers[1]
        guided = planned(car, bounds)
        if bounds != NO_ERRORS:
            # A turn on the spot would not end where it is told to.
            guided = replace(guided, turn_rate=0.0)
        self.guide = Guide(goal, waypoints, guided, config.guide, seed, frontiers, executor)
        self._sent = SentControls(car, bounds, config.mpc.dt)
        self._last: Decision | None = None
        self._unsent: Control | None = None
        """Control that was decided last, unless it was withdrawn."""
        self._before = _Before.of(self.chooser, None, self.guide)
        self._late_times: dict[str, float] = {}
        """Times of the stages of a decision that was withdrawn [ms], for the tick that skips it."""
        self.faults: Counter[Fault] = Counter()
        self._level = AdaptiveLevel(config.level, config.adapt)
        self._place, self._lingered, self._rested = (math.inf, math.inf), 0, 0
        self._tick = -1
        self._is_anew = True
        """Whether the path to the goal is still to be planned for the first time."""
        # Plans use predictions at a reliance above 0, and the guide uses them with `steer`: on a
        # prescribed route they shape the path and do not change the route.
        heard = config.reliance > 0 or config.steer
        self._predictor: NewestPrediction | None = None
        if heard and predictor is not None:
            if not isinstance(predictor, Asker | PredictorProcess):
                predictor = Asker(predictor)
            self._predictor = NewestPrediction(predictor)
        known.cover(known.frame.square(*goal, config.window))
        for x, y in () if waypoints is None else waypoints:
            known.cover(known.frame.square(float(x), float(y), WAYPOINT_SIDE))
        known.mark_free(start, config.car.body, config.start_margin)

    @property
    def path_counts(self) -> Counter[str]:
        """Number of paths followed so far, by source, of reversals, and of recovery
        manoeuvres."""
        return self.guide.counts

    @usual_float_errors()
    def step(self, state: NDArray[np.float64], scan: Scan) -> Decision:
        """Decide what to do in the next tick.

        Args:
            state: estimated x, y, yaw, v of the car, (4,) [m, m, rad, m/s].
            scan: LIDAR scan taken at that state.

        Raises:
            ValueError: if the state is not finite, or so far away that the map would need more than
                10⁹ cells; all other failures are handled and counted.
        """
        if not np.isfinite(state).all():
            raise ValueError(f"state is {state}, it must be finite")
        self._tick += 1
        clock, faults = _Clock(), list[Fault]()
        self._assume_sent()
        self._before = _Before.of(self.chooser, self._last, self.guide)
        self.guide.search_ms = 0.0
        faults += self._integrate(scan, state)
        self._level.check(self.known)
        clock.lap("integrate")
        prediction, failed = self._predict(state, clock)
        faults += failed
        faults += self.guide.take(state)
        ahead, tube = self._sent.at_effect(state)
        # A car that rolls, or is yet to roll, would not change its gear.
        waits = self.guide.awaits_leg(ahead if abs(state[3]) < REST else state)
        if waits and self._sent.holds:
            self.guide.begin_leg()
            waits = False
        self._change_gear()
        # A car in reverse is treated as one with the opposite heading that drives forward.
        if self.guide.gear < 0:
            tube = tube.mirrored()
        driven = ahead if self.guide.gear > 0 else mirrored(ahead)
        rolls_back = min(self.guide.gear * float(state[3]), driven[3]) < -REST
        driven = np.array([*driven[:3], max(driven[3], 0.0)])
        risk = self._risk_map(driven, prediction)
        clock.lap("risk")
        steering = prediction if self.config.steer else None
        first_path = 0.0
        if self._is_anew:
            # There is no path that the car could follow while the first is planned.
            faults += self._plan_next_path(driven, driven[None], risk, steering)
            clock.lap("path")
            self._is_anew, first_path = False, self.guide.search_ms
        self.guide.update(self._tick, driven, risk)
        guide = self.guide
        now = Situation(driven, risk, guide.path, guide.segment, guide.on_leg, tube)
        turn, failed = self.guide.turn_rate(state, risk)
        faults += failed
        afresh = self._tick % FRESH_GUESS_TICKS == 0 or self.guide.is_new
        if rolls_back:
            # Plans begin with a speed in the gear: none describes how the car moves.
            faults.append(Fault.ROLLS_BACK)
            self.chooser.forget()
            turn, choice = 0.0, self.chooser.halt(driven)
        elif turn:
            choice = self.chooser.stand(driven)
        elif waits:
            choice = self.chooser.halt(driven)
        else:
            choice = self.chooser.choose(now, afresh)
        faults += choice.faults
        clock.lap("mpc")
        clock.total("cycle", first_path)

        if turn or waits or rolls_back:
            self._rested = self._lingered = 0
        else:
            faults += self._plan_next_path(driven, choice.plan.states, risk, steering)
        clock.times["path"] = self.guide.search_ms
        handled = tuple(dict.fromkeys(faults))
        self.faults.update(handled)
        decision = self._last = self._decision(choice, turn, risk, prediction, handled, clock.times)
        self._unsent = decision.control
        return decision

    def head_for(self, goal: tuple[float, float]) -> None:
        """Take another goal, also while the car drives.

        The car finds its own route there, on a path that is planned in the next `step`. All that
        keeps the car safe stays: the map, the manoeuvre that was kept, the controls that were sent,
        and the level. A new navigator would know nothing of these, so it is for a car that stands.

        Args:
            goal: x, y of the goal [m].

        Raises:
            ValueError: if it is not finite, or so far away that the map would need more than 10⁹
                cells; the car then keeps the goal that it had.
        """
        if not all(map(math.isfinite, goal)):
            raise ValueError(f"goal is {goal}, it must be finite")
        self.known.cover(self.known.frame.square(*goal, self.config.window))
        self.goal = goal
        # That the car rests, at a goal it could not reach, does not mean that it is stuck.
        self._place, self._lingered, self._rested = (math.inf, math.inf), 0, 0
        for chooser in self._choosers.values():
            chooser.goal = goal
        self.guide, self._is_anew = self.guide.towards(goal), True

    def skip(self) -> Decision:
        """Go on without a decision: in a tick without a scan, or whose decision comes too late.

        The car follows the manoeuvre that was kept in the last tick, and stops if no decision
        follows.

        Raises:
            RuntimeError: in the first tick.
        """
        if self._last is None:
            raise RuntimeError("step() must decide before the first tick can be skipped")
        self._tick += 1
        self._assume_sent()
        self.faults.update((Fault.MISSED_TICK,))
        last = self._last
        acceleration, curvature = first = self.chooser.skip()
        gear = last.control.gear
        control = Control(float(acceleration), gear * float(curvature), gear)
        self._unsent = control
        # The manoeuvre that was kept, from where the plan before it has led.
        start = last.plan.states[1]
        if gear < 0:
            # Turned by half a turn to the other side, since the plan is turned back below.
            start = mirrored(start) - np.array([0.0, 0.0, 2.0 * math.pi, 0.0])
        plan = self.chooser.mpc.roll(start, np.vstack([first, self.chooser.kept[:-1]]))
        self._last = replace(
            last,
            control=control,
            plan=plan if gear > 0 else plan.mirrored(),
            last_resort=shifted(last.last_resort, self.config.car.braking),
            limit=Limit.UNSEEN if last.emergency else last.limit,
            faults=(Fault.MISSED_TICK,),
            relied=np.empty((0, 2)),
            emergency=False,
            times=self._late_times,
            prediction=None,
        )
        self._late_times = {}
        return self._last

    def withdraw(self) -> None:
        """Take back the decision of the last `step`, since it came too late and was not sent.

        What was kept before it is kept again, in the gear of that time, so that `skip` goes on with
        it. The scan stays in the map.
        """
        if self._last is not None:
            self._late_times = self._last.times
        if self.guide.gear != self._before.leg.gear:
            self.guide.recall(self._before.leg)
        self.chooser, self._last = self._before.chooser, self._before.decision
        self.chooser.recall(self._before.memory)
        self._unsent = None

    def _assume_sent(self) -> None:
        """Add the last control to those that were sent, unless it was withdrawn."""
        if self._unsent is not None:
            self._sent.add(self._unsent)
        self._unsent = None

    def _decision(
        self,
        choice: Choice,
        turn: float,
        risk: RiskMap,
        prediction: Prediction | None,
        faults: tuple[Fault, ...],
        times: dict[str, float],
    ) -> Decision:
        """Return the decision for a choice: the control in the current gear, and its reasons.

        `turn` is the yaw rate of a turn on the spot, on which the car stands otherwise [rad/s].
        """
        plan, config = choice.plan, self.config
        # Within the car's limits, to which its controls are clipped.
        kept = self.chooser.mpc.roll(plan.states[1], self.chooser.kept)
        rows, cols = swept_cells(
            plan, config.mpc.dt, config.car.body, risk.frame, risk.known.unknown
        )
        xs, ys = risk.frame.centres()
        limit = what_limits(plan, risk, self.goal, self.chooser.mpc.limits, choice.emergency)
        if plan is not choice.intended:
            # The last resort holds the car back, in case the prediction is wrong.
            limit = Limit.UNSEEN
        if self.guide.gear < 0:
            plan, kept = plan.mirrored(), kept.mirrored()
        acceleration, curvature = plan.controls[0].tolist()
        if not config.bounds.moves_exactly and np.abs(plan.states[:2, 3]).max() < REST:
            # A car that is faster than planned brakes on.
            acceleration = -config.car.braking
        return Decision(
            control=Control(acceleration, curvature, plan.gear, turn),
            plan=plan,
            last_resort=np.vstack([plan.controls[:1], kept.controls[:-1]]),
            limit=limit,
            faults=faults,
            relied=np.column_stack([xs[cols], ys[rows]]),
            emergency=choice.emergency,
            times=times,
            risk_map=risk,
            prediction=prediction,
            path=self.guide.path,
        )

    def _integrate(self, scan: Scan, state: NDArray[np.float64]) -> tuple[Fault, ...]:
        """Add a scan to the observed map; a scan that cannot be read is a fault."""
        faults: tuple[Fault, ...] = ()
        try:
            self.known.integrate(scan, state, self.config.bounds)
        except Exception:
            # The driver of a LIDAR may deliver anything; the car goes on with the map that it has.
            faults = (Fault.BAD_SCAN,)
        # Cells under the body are free whatever a scan says: the car must be able to leave them.
        self.known.mark_under(state, self.config.car.body, self.config.bounds)
        return faults

    def _risk_map(self, driven: NDArray[np.float64], prediction: Prediction | None) -> RiskMap:
        """Return the risk map around the car, whose state `driven` is mirrored in reverse."""
        c = self.config
        centre = driven[:2] + RISK_MAP_AHEAD * np.array([math.cos(driven[2]), math.sin(driven[2])])
        frame = self.known.frame.square(float(centre[0]), float(centre[1]), c.risk_side)
        # In reverse the car enters only cells that were observed free.
        epsilon = c.reliance if self.guide.gear > 0 else 0.0
        believed = prediction if epsilon > 0 else None
        level = 0.0 if believed is None else self._level.doubted(believed.doubt)
        seen = self.known.crop(frame)
        risk = RiskMap.from_prediction(seen, believed, epsilon, level)
        self._level.believe(risk)
        return risk

    def _change_gear(self) -> None:
        chooser = self._choosers[self.guide.gear]
        if chooser is not self.chooser:
            self.chooser = chooser
            chooser.forget()
            # The new leg has just begun: a search now would discard it.
            self._lingered = 0

    def _plan_next_path(
        self,
        state: NDArray[np.float64],
        ahead: NDArray[np.float64],
        risk: RiskMap,
        steering: Prediction | None,
    ) -> tuple[Fault, ...]:
        """Plan a path if one is due, or a recovery manoeuvre if the car has hardly moved lately.

        `ahead` are the states of the plan, (n, 4), of which the current one is the first.

        Returns:
            The faults that were handled.
        """
        if math.dist(state[:2], self._place) > 0.1:
            self._place, self._lingered = (float(state[0]), float(state[1])), 0
        self._lingered += 1
        then = float(ahead[min(1, len(ahead) - 1), 3])
        moves = max(state[3], then) > 0.02
        self._rested = 0 if moves else self._rested + 1
        stuck = self._rested and self._rested % REST_TICKS == 0
        if stuck or self._lingered % LINGER_TICKS == 0:
            return self.guide.unstick(self._tick, state, self.known, risk, steering, then)
        return self.guide.plan_if_due(self._tick, ahead, self.known, risk, steering)

    def _predict(
        self, state: NDArray[np.float64], clock: _Clock
    ) -> tuple[Prediction | None, tuple[Fault, ...]]:
        """Return the predictor's newest answer, or None if it fails, and the faults."""
        if self._predictor is None:
            return None, ()
        asker, patience = self._predictor.asker, self.config.deadline
        if self._tick == 0:
            patience = max(FIRST_DEADLINE, patience)
        side = asker.side or self.config.predicted_side
        view = View.of(self.known, state[:3].copy(), side, asker.context_side)
        clock.lap("crop")
        answer = self._predictor.ask(view, patience)
        clock.lap("predict")
        return answer


class _Before(NamedTuple):
    """What `Navigator.withdraw` goes back to.

    Attributes:
        chooser: chooser of the gear.
        memory: what it remembers.
        decision: decision before; None: there was none.
        leg: what the guide followed, and in which gear.
    """

    chooser: PlanChooser
    memory: PlanMemory
    decision: Decision | None
    leg: Leg

    @classmethod
    def of(cls, chooser: PlanChooser, decision: Decision | None, guide: Guide) -> _Before:
        """Return what there is before a step."""
        return cls(chooser, chooser.memory(), decision, guide.leg())


class _Clock:
    """Measures the wall-clock times of the stages of one tick [ms]."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}
        self._start = self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.times[stage] = 1e3 * (now - self._last)
        self._last = now

    def total(self, stage: str, without: float) -> None:
        """Record the time from the start to the last lap, less a part [ms] recorded elsewhere."""
        self.times[stage] = 1e3 * (self._last - self._start) - without
