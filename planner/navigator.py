"""The navigator: from a scan to a control, tick after tick."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.guide.guide import Guide, GuideConfig
from planner.motion.goal import GOES_ON, PLAN_REACHES
from planner.motion.path import SPACING, Path, project
from planner.motion.plan import Plan, mirrored
from planner.mpc.guess import pursue, shifted
from planner.mpc.mpc import MPC, MPCConfig, stop_controls
from planner.risk.asking import Asker, LateError, RaisedError
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.last_resort import LastResort
from planner.safety.speed_limits import Limit, what_limits
from planner.safety.sweep import swept_cells
from predictor.mapping.car_limits import CarLimits, check_finite
from predictor.mapping.grid import Grid, OccupancyGrid
from predictor.mapping.scan import Scan
from predictor.prediction import BadPredictionError, Prediction, Predictor

FIRST_DEADLINE = 180.0
"""The first answer may have to load and compile first, on a busy machine [s]."""
BESIDE = 5.0
"""Side of the squares about the points of a given way that the map holds from the start [m]."""
AHEAD = 2.5
"""How far the risk map's centre lies ahead of the car [m]."""
PATIENCE = 4
"""Ticks at rest after which a way out is searched for, and between such searches."""
LONG_PATIENCE = 15
"""Likewise, ticks within 0.1 m: a car may start and brake, over and over."""
AFRESH = 5
"""Ticks from one start that is not the last plan to the next, while nothing is wrong."""


@dataclass(frozen=True)
class NavigatorConfig:
    """Settings of the chain.

    Attributes:
        window: side of the square that the LIDAR writes into [m].
        expansion: how many times wider the predicted square is.
        risk: the dial ε in [0, 1]: what a plan may rely upon.
        steer: whether a prediction also moves the route.
        margin: what the safe set is eroded by [m]; 0 for a noise-free LIDAR.
        start_margin: around the body at the start that counts as seen free [m].
        oracle: whether the predictor is told the truth, so that what it is certain of counts as
            seen. Of a comparison's arm alone: a car that trusts a plug-in so may collide.
        deadline: a prediction later than this is not used [s]. Far above what one takes: in
            simulation the clock stands still meanwhile, and a tick must not depend on luck.
        car: what the car can do.
        mpc: settings of the MPC.
        guide: settings of path planning.
    """

    window: float = 5.0
    expansion: float = 2.0
    risk: float = 0.0
    steer: bool = False
    margin: float = 0.0
    start_margin: float = 0.5
    oracle: bool = False
    deadline: float = 2.0
    car: CarLimits = field(default_factory=CarLimits)
    mpc: MPCConfig = field(default_factory=MPCConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)

    def __post_init__(self) -> None:
        if not 0.0 <= self.risk <= 1.0:
            raise ValueError(f"risk is {self.risk}, it must lie in [0, 1]")
        if not self.expansion >= 1.0:
            raise ValueError(f"expansion is {self.expansion}, it must be at least 1")
        check_finite(self, "window", "deadline")
        check_finite(self, "margin", "start_margin", zero=True)

    @property
    def predicted_side(self) -> float:
        """Side of the predicted square [m]: no more than the car can make use of."""
        return min(self.window * self.expansion, max(10.0, 2 * (self.car.stopping_distance + 1.5)))

    @property
    def risk_side(self) -> float:
        """Side of the risk map [m]: a full stop fits ahead of the car."""
        return max(10.0, 2 * (self.car.stopping_distance + 1.0 - AHEAD))


@dataclass(frozen=True, eq=False)
class Decision:
    """All that a tick decided, and why.

    Attributes:
        control: a [m/s²], κ [1/m] to apply for one `dt`.
        plan: the motion it begins.
        limit: what kept the car from going faster.
        faults: what went wrong and was survived in this tick, each kind once.
        relied: centres of the cells not seen that the plan sweeps, (k, 2) [m].
        relied_trust: confidence · p_free of each, (k,).
        emergency: no plan was safe on the newest map: the car brakes as hard as it can.
        times: stage → [ms]; "cycle" is scan in to control out, "path" runs beside it.
        risk_map: what the plan relied upon.
        prediction: what was believed, if anything.
        path: what the plan follows, if anything.
    """

    control: NDArray[np.float64]
    plan: Plan
    limit: Limit
    faults: tuple[str, ...]
    relied: NDArray[np.float64]
    relied_trust: NDArray[np.float32]
    emergency: bool
    times: dict[str, float]
    risk_map: RiskMap
    prediction: Prediction | None
    path: Path | None


class Navigator:
    """Drives a car to a goal through space that it comes to see.

    Args:
        config: settings.
        predictor: extends the known map; None: nothing is predicted.
        start: x, y, yaw (and v) at the start, (3,) or (4,).
        goal: x, y [m].
        known: what is known at the start; it is written to.
        waypoints: (n, 2) a route given as the task, or None: find one.
        seed: of the path search.
    """

    def __init__(
        self,
        config: NavigatorConfig,
        predictor: Predictor | None,
        start: NDArray[np.float64],
        goal: tuple[float, float],
        known: OccupancyGrid,
        waypoints: NDArray[np.float64] | None = None,
        seed: int = 0,
    ) -> None:
        self.config, self.goal, self.known = config, goal, known
        self._drives = {1: self._drive(config.car)}
        if config.car.reverse > 0.0:
            self._drives[-1] = self._drive(replace(config.car, v_max=config.car.reverse))
        self.mpc, self.checker, self.resort = self._drives[1]
        self.guide = Guide(goal, waypoints, config.car, config.guide, seed)
        self.faults: Counter[str] = Counter()
        self.plan: Plan | None = None
        self._gear = 1
        self._place, self._lingered, self._rested = (math.inf, math.inf), 0, 0
        self._tick = -1
        self._curvature = 0.0
        # On a given route a prediction shapes the line, and does not change the route.
        heard = config.risk > 0 or config.steer
        self._asker = Asker(predictor) if predictor is not None and heard else None
        known.cover(known.frame.square(*goal, config.window))
        for x, y in () if waypoints is None else waypoints:
            known.cover(known.frame.square(float(x), float(y), BESIDE))
        known.mark_free(start, config.car.body, config.start_margin)

    @property
    def path_counts(self) -> Counter[str]:
        """Number of paths followed so far, by the method that planned them."""
        return self.guide.counts

    def step(self, state: NDArray[np.float64], scan: Scan) -> Decision:
        """Decide what to do in the next `dt`.

        Args:
            state: x, y, yaw, v, (4,).
            scan: taken at that state.

        Raises:
            ValueError: if the state is not finite; everything else is survived and counted.
        """
        if not np.isfinite(state).all():
            raise ValueError(f"state is {state}, it must be finite")
        self._tick += 1
        clock = _Clock()
        faults: list[str] = []
        try:
            self.known.integrate(scan, state)
        except Exception:
            # A driver may hand over anything; none of it may reach the wheels.
            faults.append("bad_scan")
        c = self.config
        # Wherever the body is, there is nothing else: it must be able to back out of there.
        self.known.mark_free(state, c.car.body, 0.0)
        clock.lap("integrate")
        prediction = None
        if self._asker is not None:
            square = self.known.frame.square(float(state[0]), float(state[1]), c.predicted_side)
            crop = self.known.crop(square)
            clock.lap("crop")
            prediction = self._predict(self._asker, crop, state, faults)
            clock.lap("predict")
        self._shift(self.guide.shift(state))
        # In reverse the car drives as one that looks the other way does forward.
        driven = state if self._gear > 0 else mirrored(state)
        driven = np.array([*driven[:3], max(driven[3], 0.0)])
        centre = driven[:2] + AHEAD * np.array([math.cos(driven[2]), math.sin(driven[2])])
        frame = self.known.frame.square(float(centre[0]), float(centre[1]), c.risk_side)
        # It reverses through what was seen free alone.
        epsilon = c.risk if self._gear > 0 else 0.0
        believed = prediction if epsilon > 0 else None
        seen = self.known.crop(frame)
        risk = RiskMap.from_prediction(seen, believed, epsilon, c.margin, c.oracle)
        clock.lap("risk")
        steering = prediction if c.steer else None
        first_path = 0.0
        if self._tick == 0:
            # The car stands, and has no path to drive meanwhile.
            self._look_ahead(driven, driven[None], risk, steering, faults)
            clock.lap("path")
            first_path = self.guide.plan_ms
        self.guide.update(self._tick, driven, risk)
        intended, emergency = self._decide(driven, risk, faults)
        intended = self._at_once(driven, intended, risk)
        plan = intended
        if emergency:
            faults.append("emergency")
        else:
            plan, survivable = self.resort.begin(driven, intended, risk)
            if not survivable:
                faults.append("no_last_resort")
        control = plan.controls[0].copy()
        clock.lap("mpc")
        clock.total("cycle", first_path)

        self._look_ahead(driven, plan.states, risk, steering, faults)
        clock.times["path"] = first_path + self.guide.plan_ms
        rows, cols = swept_cells(plan, c.mpc.dt, c.car.body, frame, risk.known.unknown)
        xs, ys = frame.centres()
        limit = what_limits(plan, risk, self.goal, self.mpc.limits, emergency)
        if plan is not intended:
            # It is held back for the case that what was not seen is not as believed.
            limit = Limit.UNSEEN
        self.plan, self._curvature = intended, float(control[1])
        if self._gear < 0:
            plan = plan.mirrored()
            control = np.array([*plan.controls[0], -1.0])
        survived = tuple(dict.fromkeys(faults))
        self.faults.update(survived)
        return Decision(
            control=control,
            plan=plan,
            limit=limit,
            faults=survived,
            relied=np.column_stack([xs[cols], ys[rows]]),
            relied_trust=risk.trust[rows, cols],
            emergency=emergency,
            times=clock.times,
            risk_map=risk,
            prediction=prediction,
            path=self.guide.path,
        )

    def _drive(self, car: CarLimits) -> tuple[MPC, CollisionChecker, LastResort]:
        mpc, checker = MPC(car, self.config.mpc), CollisionChecker(car, self.config.mpc.dt)
        return mpc, checker, LastResort(mpc, checker)

    def _shift(self, gear: int) -> None:
        if gear != self._gear:
            self._gear = gear
            self.mpc, self.checker, self.resort = self._drives[gear]
            self.plan, self.resort.controls, self._curvature = None, None, 0.0

    def _look_ahead(
        self,
        state: NDArray[np.float64],
        ahead: NDArray[np.float64],
        risk: RiskMap,
        steering: Prediction | None,
        faults: list[str],
    ) -> None:
        """Request a path, or a way out if the car has not moved on for a while.

        Args:
            state: x, y, yaw, v now, (4,).
            ahead: planned states, from now on, (n, 4).
            risk: the newest map around the car.
            steering: a prediction that may change the route, or None.
            faults: list to which failures are appended.
        """
        if math.dist(state[:2], self._place) > 0.1:
            self._place, self._lingered = (float(state[0]), float(state[1])), 0
        self._lingered += 1
        moves = max(state[3], ahead[min(1, len(ahead) - 1), 3]) > 0.02
        self._rested = 0 if moves else self._rested + 1
        stuck = self._rested and self._rested % PATIENCE == 0
        try:
            if stuck or self._lingered % LONG_PATIENCE == 0:
                self.guide.unstick(self._tick, state, self.known, steering)
            else:
                self.guide.request(self._tick, ahead, self.known, risk, steering)
        except Exception:
            # OMPL is others' code. Without a new path the car goes on along the last one.
            faults.append("path_failed")

    def _predict(
        self, asker: Asker, crop: Grid, state: NDArray[np.float64], faults: list[str]
    ) -> Prediction | None:
        """Ask the predictor; whatever it does wrong leaves the car with what it knows."""
        patience = self.config.deadline
        if self._tick == 0:
            patience = max(FIRST_DEADLINE, patience)
        try:
            prediction = asker.ask(crop, state[:3].copy(), patience)
            if prediction.nan_cells:
                faults.append("predictor_nan")
            return prediction
        except LateError:
            faults.append("predictor_late")
        except BadPredictionError:
            faults.append("predictor_bad")
        except RaisedError:
            faults.append("predictor_raised")
        return None

    def _decide(
        self, state: NDArray[np.float64], risk: RiskMap, faults: list[str]
    ) -> tuple[Plan, bool]:
        """The cheapest safe plan; where none is safe, the least bad way to brake."""
        mpc, car = self.mpc, self.mpc.limits
        stop = mpc.roll(state, stop_controls(mpc.stages, car.braking, self._curvature))
        kept = stop
        if self.plan is not None:
            kept = mpc.roll(state, shifted(self.plan.controls, car.braking))
        path = self.guide.path
        rest = [kept, stop]
        if self.resort.controls is not None:
            rest.insert(0, mpc.roll(state, self.resort.controls))
        safe = [plan for plan in rest if self.checker.is_safe(plan, risk)]
        if path is None:
            if safe:
                return safe[-1], False
            return self.resort.brake(state, kept, risk), True

        def cost(plan: Plan) -> float:
            return mpc.evaluate(plan, path, risk, self.guide.segment, self._curvature)

        guesses = [kept.controls]
        if self._tick % AFRESH == 0 or self.guide.is_new or not safe or state[3] < 0.3:
            guesses.append(self._pursuit(state, path, risk))
        solved = self._solutions(state, path, risk, guesses, faults)
        if not solved:
            faults.append("no_safe_solution")
        candidates = sorted(solved + safe, key=cost)
        if not candidates:
            return self.resort.brake(state, kept, risk), True
        # At the goal the drive is over: no cost of what would follow may make the car pass it by.
        best = min(candidates, key=self._arrival)
        if self._goes_on(best, risk):
            return best, False
        # A car that cannot reverse had better not stop with its nose against a wall.
        sooner = self._stopping_sooner(state, path, risk, best, faults)
        if sooner is not None:
            return sooner, False
        # Or brake and swerve to where it can go on from, while there is still room for that.
        stops = (mpc.roll(state, way) for way in self.resort.ways(best))
        others = [
            *candidates,
            *sorted((p for p in stops if self.checker.is_safe(p, risk)), key=cost),
        ]
        # Standing still for ever is no better than standing there.
        moving = (p for p in others if p.states[:, 3].max() > 0.1)
        return next((p for p in moving if self._goes_on(p, risk)), best), False

    def _arrival(self, plan: Plan) -> float:
        """The first stage at which a plan is at the goal; infinite where it does not get there."""
        off = np.hypot(*(plan.states[:, :2] - np.array(self.goal)).T)
        return float(np.argmax(off < PLAN_REACHES)) if off.min() < PLAN_REACHES else math.inf

    def _at_once(self, state: NDArray[np.float64], plan: Plan, risk: RiskMap) -> Plan:
        """Drop the steps at the start of a plan during which a standing car would wait.

        A solver may return a plan that moves only later, again at every tick.
        """
        moves = np.flatnonzero(plan.states[1:, 3] > 1e-3)
        if state[3] > 0.0 or not len(moves) or moves[0] == 0:
            return plan
        first = int(moves[0])
        rest = stop_controls(first, self.mpc.limits.braking, float(plan.controls[-1, 1]))
        sooner = self.mpc.roll(state, np.vstack([plan.controls[first:], rest]))
        return sooner if self.checker.is_safe(sooner, risk) else plan

    def _stopping_sooner(
        self,
        state: NDArray[np.float64],
        path: Path,
        risk: RiskMap,
        best: Plan,
        faults: list[str],
    ) -> Plan | None:
        """A plan that stops before the best one's end, where the car can go on from; or None."""
        end, _, _ = project(path.points, *best.states[-1, :2], self.guide.segment, 10**6)  # type: ignore[call-arg]
        for sooner in (0.5, 1.0, 1.5, 2.0):
            last = end - round(sooner / SPACING)
            if last < self.guide.segment + 3:
                break
            shorter = Path(path.points[:last], path.source)
            guess = self._pursuit(state, shorter, risk)
            for plan in self._solutions(state, shorter, risk, [guess], faults):
                if self._goes_on(plan, risk):
                    return plan
        return None

    def _solutions(
        self,
        state: NDArray[np.float64],
        path: Path,
        risk: RiskMap,
        guesses: list[NDArray[np.float64]],
        faults: list[str],
    ) -> list[Plan]:
        """The safe ones among the plans that the MPC makes of some guesses."""
        solved = []
        for guess in guesses:
            try:
                solution = self.mpc.solve(
                    state, path, risk, guess, self.guide.segment, self._curvature
                )
            except Exception:
                # Solvers raise what they like; there is another plan, or the car stops.
                faults.append("solver_failed")
                continue
            if solution.failed:
                faults.append("solver_failed")
            if self.checker.is_safe(solution.plan, risk):
                solved.append(solution.plan)
        return solved

    def _goes_on(self, plan: Plan, risk: RiskMap) -> bool:
        """Whether from a plan's end some arc, or straight on, meets nothing that is barred."""
        x, y = plan.states[-1, :2]
        if math.hypot(x - self.goal[0], y - self.goal[1]) < GOES_ON:
            return True
        return self.checker.leads_on(plan.states[-1], risk)

    def _pursuit(
        self, state: NDArray[np.float64], path: Path, risk: RiskMap
    ) -> NDArray[np.float64]:
        """Controls that follow the path as far as it is safe."""
        mpc, car = self.mpc, self.mpc.limits
        free = math.inf
        controls = np.zeros((mpc.stages, 2))
        for _ in range(2):
            controls = pursue(
                path.points, self.guide.segment, state, mpc.stages, mpc.config.dt, car.v_max,
                car.acceleration, car.braking, car.lateral_acceleration, car.max_curvature,
                min(free, 1e6),
            )  # fmt: skip
            met = self.checker.contact(mpc.roll(state, controls), ~risk.safe, risk.frame)
            if met is None:
                break
            free = max(met[0] - 0.1, 0.0)
        return controls


class _Clock:
    """Wall-clock time of the stages of one tick [ms]."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}
        self._start = self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.times[stage] = 1e3 * (now - self._last)
        self._last = now

    def total(self, stage: str, without: float) -> None:
        """Record the time since the start, less a time [ms] that is recorded elsewhere."""
        self.times[stage] = 1e3 * (self._last - self._start) - without
