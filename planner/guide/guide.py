"""The guide: plan paths to the goal, choose between them, and track the car on them."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.frontiers import FrontierPredictor
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.context import SIDE, coarse_map
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import BadPredictionError, Prediction, View
from planner.fault import Fault
from planner.guide.elastic_band import BODY_MARGIN, LineConfig
from planner.guide.hybrid_astar import HybridConfig, Leg, find_legs
from planner.guide.ompl_search import PathConfig, plan_path
from planner.guide.route import find_route
from planner.guide.smoothing import Smoother
from planner.guide.subgoals import with_frontiers
from planner.guide.turn import angle_to, can_turn, rate_towards
from planner.motion.goal import PATH_GOAL_RADIUS
from planner.motion.path import POINT_SPACING, Path, project
from planner.motion.plan import mirrored
from planner.risk.ask_predictor import FIRST_DEADLINE, Asker, LateError
from planner.risk.cost_map import Belief, CostMap, remember, remember_far
from planner.risk.predictor_process import PredictorProcess
from planner.risk.risk_map import RiskMap

REST = 1e-6
"""Speed below which a car stands, and may change its gear [m/s]."""
PRESCRIBED_TETHER = 8.0
"""Weight of the squared distance from a prescribed route, in unobserved cells [1/m²].

A line that cuts the route's corners there may lead towards a wall, observed too late to turn."""

TURN_FROM, TURN_FROM_STUCK = 1.2, 0.4
"""Angle between the heading and the route from which a car at rest turns on the spot, and the same
for a car that is stuck [rad]."""
BACK_LENGTH = 4.0
"""Length of the way by whose direction a path leads back or not [m]."""


@dataclass(frozen=True)
class GuideConfig:
    """Settings of the guide: when it plans a path, and which path it adopts.

    Attributes:
        every: number of ticks from one request for a path to the next, in normal driving.
        delay: number of ticks from a request to the adoption of its path; the search may take this
            long.
        ahead: distances along the route that OMPL's curves reach, tried in this order [m].
        better: ratio of a new path's price to the present one's below which it replaces that path.
        join: distance ahead along a prescribed route at which a path joins it [m].
        beside: distance from a prescribed route within which the car counts as following it [m].
        turning_room: distance before an obstacle at which a blocked path is cut off [m].
        leg_end: distance from a leg's end within which a car at rest has completed the leg [m].
        onward: reduction of the cost to go at which the hybrid A* search ends [m].
        search: settings of the search with OMPL.
        hybrid: settings of the hybrid A* search.
        line: settings of the smooth line.
    """

    every: int = 8
    delay: int = 1
    ahead: tuple[float, ...] = (9.0, 5.0, 3.0)
    better: float = 0.95
    join: float = 12.0
    beside: float = 1.0
    turning_room: float = 1.2
    leg_end: float = 0.12
    onward: float = 6.0
    search: PathConfig = field(default_factory=PathConfig)
    hybrid: HybridConfig = field(default_factory=HybridConfig)
    line: LineConfig = field(default_factory=LineConfig)


class _Costs(NamedTuple):
    """What a search for a path minimises.

    Attributes:
        map: cost map.
        prescribed: rest of the prescribed route, (n, 2) [m]; None: the guide finds a route.
        faults: faults that were handled.
    """

    map: CostMap
    prescribed: NDArray[np.float64] | None
    faults: tuple[Fault, ...]


class Guide:
    """Plans paths, adopts each a fixed number of ticks later, and tracks the car on them.

    The car follows a smooth line, along its present path or along the route that Dijkstra's
    algorithm finds, whichever is cheaper. If it can drive neither, a hybrid A* search looks for a
    path, and then OMPL. If the car rests, hybrid A* looks for a recovery manoeuvre, in both gears
    if the car has two. The manoeuvre consists of legs; the car changes gear between them.

    Args:
        goal: x, y of the goal [m].
        waypoints: points of a prescribed route, (n, 2) [m]; None: the guide finds a route.
        car: the car's limits and body.
        config: settings of the guide.
        seed: seed of OMPL's samples.
        frontiers: predictor of frontiers, by which a route that is not prescribed is chosen, or
            None.
        far: predictor of what lies far ahead, which is asked when such a route is planned, or None.
        deadline: longest wait for a far prediction [s].

    Attributes:
        path: path to follow, up to an obstacle on it; None: there is none yet.
        segment: index of the path's segment near which the car is.
        is_new: whether the path was adopted in this tick.
        counts: number of paths adopted, by source, of those that lead back ("reversal"), and of
            recovery manoeuvres.
        plan_ms: duration of the last planning, which is no part of the control cycle [ms].
        gear: gear to drive in, 1 or -1.
        on_leg: whether the path is a leg of a recovery manoeuvre, at whose end the car stops.
        turn_to: yaw at which a turn on the spot ends [rad]; None: the car does not turn.
    """

    def __init__(
        self,
        goal: tuple[float, float],
        waypoints: NDArray[np.float64] | None,
        car: CarLimits,
        config: GuideConfig,
        seed: int,
        frontiers: FrontierPredictor | None = None,
        far: Asker | PredictorProcess | None = None,
        deadline: float = 0.5,
    ) -> None:
        self.goal, self.car, self.config, self.seed = goal, car, config, seed
        self._route = None if waypoints is None else Path.through(waypoints, "given").points
        self._route_segment = 0
        self._frontiers, self._far, self._deadline = frontiers, far, deadline
        self._patience = FIRST_DEADLINE
        self.path: Path | None = None
        self._whole: Path | None = None
        self._belief: Belief | None = None
        self._far_belief: Belief | None = None
        self.segment = 0
        self.is_new = False
        self.counts: Counter[str] = Counter()
        self.plan_ms = 0.0
        self.gear = 1
        self._pending: tuple[int, Path] | None = None
        self._requested = -(10**9)
        self._legs: list[tuple[int, Path]] = []
        self.on_leg = False
        self.turn_to: float | None = None
        self._stuck = np.empty((0, 2))

    def begin_leg(self, state: NDArray[np.float64]) -> None:
        """Begin the next leg of a recovery manoeuvre if the car stands at the end of the last one.

        Args:
            state: current x, y, yaw, v of the car, (4,).
        """
        if not self._legs or abs(state[3]) > REST:
            return
        if self.on_leg:
            if math.dist(self._legs[0][1].points[-1], state[:2]) > self.config.leg_end:
                return
            del self._legs[0]
        self.gear, path = self._legs[0]
        self._adopt(path)
        self.on_leg = len(self._legs) > 1
        # The last leg is an ordinary path.
        if not self.on_leg:
            self._legs = []

    def turn_rate(self, state: NDArray[np.float64], risk: RiskMap) -> float:
        """Return the yaw rate of the turn on the spot under way [rad/s]; 0: there is none.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            risk: newest risk map around the car.
        """
        if self.turn_to is None:
            return 0.0
        rate = rate_towards(self.turn_to, state, risk, self.car)
        if rate == 0.0:
            # A path is due at once.
            self.turn_to, self._requested = None, -(10**9)
        return rate

    def update(self, tick: int, state: NDArray[np.float64], risk: RiskMap) -> None:
        """Advance by a tick: adopt a path that is due, and cut it off before an obstacle.

        Args:
            tick: number of this tick.
            state: current x, y, yaw, v of the car, mirrored in reverse, (4,).
            risk: newest risk map around the car.
        """
        self.is_new = False
        if self._pending is not None and tick >= self._pending[0]:
            path = self._pending[1]
            if self._whole is not None and _leads_back(self._whole, self.segment, path):
                self.counts["reversal"] += 1
            self._adopt(path)
            self._pending = None
        if self._whole is not None:
            # A new path starts where the car was expected to be; it may have gone some metres on.
            reach = 40 if self.is_new else 15
            self.segment, _, _ = project(
                self._whole.points, state[0], state[1], self.segment - 5, self.segment + reach
            )
            self.path = self._unblocked(self._whole, risk)

    def plan_if_due(
        self,
        tick: int,
        ahead: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
    ) -> tuple[Fault, ...]:
        """Plan a path if one is due, to be adopted `delay` ticks from now.

        Args:
            tick: number of this tick.
            ahead: states of the car's plan, the current one first, (n, 4).
            known: observed map.
            risk: newest risk map around the car.
            steering: prediction that may change the route, or None.

        Returns:
            The faults that were handled. If the search fails, the guide keeps its path.
        """
        self.plan_ms = 0.0
        if self._legs or self.gear < 0 or self._is_held():
            return ()
        urgent = self.path is not self._whole or ahead[:, 3].max() < 0.2
        overdue = tick - self._requested >= self.config.every
        due = self._pending is None and (overdue or (urgent and tick - self._requested >= 3))
        if not due:
            return ()
        self._requested = tick
        # A car without a path stands: its path can begin at the present state.
        delay = 0 if self.path is None else self.config.delay
        begin = ahead[min(delay, len(ahead) - 1)]
        started, faults = time.perf_counter(), list[Fault]()
        try:
            costs = self._costs(known, steering, (float(begin[0]), float(begin[1])))
            faults += costs.faults
            if self._turns(ahead[0], risk, costs, TURN_FROM):
                return tuple(faults)
            path = self._plan(tick, begin, known, risk, costs)
        except Exception:
            # OMPL may raise anything. Without a new path the car goes on along the last one.
            return (*faults, Fault.PATH_FAILED)
        self.plan_ms = 1e3 * (time.perf_counter() - started)
        if path is not None:
            self._pending = (tick + delay, path)
        return tuple(faults)

    def unstick(
        self,
        tick: int,
        state: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
    ) -> tuple[Fault, ...]:
        """Search for a recovery manoeuvre for a car at rest, in both gears if it has two.

        A car that can turn on the spot turns towards its route, if there is room.

        Args:
            tick: number of this tick.
            state: current x, y, yaw, v of the car, mirrored in reverse, (4,).
            known: observed map.
            risk: newest risk map around the car.
            steering: prediction that may change the route, or None.

        Returns:
            The faults that were handled. If the search fails, the guide keeps its path.
        """
        started, faults = time.perf_counter(), list[Fault]()
        pose = state if self.gear > 0 else mirrored(state)
        front = pose[:2] + self.car.body.half_length * np.array(
            [math.cos(pose[2]), math.sin(pose[2])]
        )
        stuck = np.vstack([self._stuck, front])
        try:
            costs = self._costs(known, steering, (float(pose[0]), float(pose[1])))
            faults += costs.faults
            if self._turns(pose, risk, costs, TURN_FROM_STUCK):
                self._stuck = stuck
                return tuple(faults)
            manoeuvre = self._manoeuvre(costs.map, known, pose, stuck)
        except Exception:
            return (*faults, Fault.PATH_FAILED)
        self._legs, self._stuck = manoeuvre, stuck
        self._requested = tick
        self.on_leg, self._pending = False, None
        self.counts["manoeuvre"] += bool(self._legs)
        self.plan_ms = 1e3 * (time.perf_counter() - started)
        return tuple(faults)

    def _turns(
        self, state: NDArray[np.float64], risk: RiskMap, costs: _Costs, least: float
    ) -> bool:
        """Begin a turn on the spot towards the route, and return whether the car turns.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            risk: newest risk map around the car.
            costs: what the search for a route minimises.
            least: angle to the route below which the car does not turn [rad].
        """
        if self.car.turn_rate == 0.0 or abs(state[3]) > REST:
            return False
        route = self._find_route(costs, (float(state[0]), float(state[1])))
        if route is None:
            return False
        angle = angle_to(route, state)
        if abs(angle) < least or not can_turn(state, angle, risk, self.car):
            return False
        self.turn_to, self.gear, self.on_leg = float(state[2]) + angle, 1, False
        self._legs, self._pending, self.path, self._whole = [], None, None, None
        self.counts["turn"] += 1
        return True

    def _manoeuvre(
        self,
        cost: CostMap,
        known: OccupancyGrid,
        pose: NDArray[np.float64],
        stuck: NDArray[np.float64],
    ) -> list[tuple[int, Path]]:
        """Return gear and path of each leg of a recovery manoeuvre; empty if there is none.

        It avoids the places where the car got stuck, `stuck` (k, 2), if it can.
        """
        c = self.config
        for places in (stuck, stuck[:0]):
            legs = find_legs(cost, known, pose, self.goal, c.onward, places, self.car, c.hybrid)
            if legs:
                break
        paths = [(leg.gear, Path.through(leg.poses[:, :2], "hybrid")) for leg in legs[:-1]]
        return paths + [(leg.gear, self._onward(cost, leg)) for leg in legs[-1:]]

    def _adopt(self, path: Path) -> None:
        self._whole, self.segment, self.is_new = path, 0, True
        self.counts[path.source] += 1

    def _is_held(self) -> bool:
        """Return whether the car must complete the arcs of a hybrid A* path before it replans."""
        path = self._whole
        if path is None or path.source != "hybrid" or self.path is not path:
            return False
        return path.drivable - self.segment > 0.5 / POINT_SPACING

    def _unblocked(self, path: Path, risk: RiskMap) -> Path:
        """Return the path, cut off before the next obstacle on it so that there is room to turn."""
        coming = path.points[self.segment : self.segment + 100]
        inside, rows, cols = risk.frame.locate(coming)
        blocked = risk.obstacle_distance[rows, cols] < self.car.body.half_width + BODY_MARGIN
        if not blocked.any():
            return path
        first = self.segment + int(np.flatnonzero(inside)[np.argmax(blocked)])
        end = max(first - round(self.config.turning_room / POINT_SPACING), self.segment + 2)
        return Path(path.points[:end], path.source)

    def _costs(
        self,
        known: OccupancyGrid,
        steering: Prediction | None,
        position: tuple[float, float],
    ) -> _Costs:
        """Return the cost map, and the rest of the prescribed route if there is one."""
        faults: tuple[Fault, ...] = ()
        if steering is not None:
            self._belief = remember(self._belief, known.frame, steering)
        route = self._route
        prescribed = None if route is None else self._rest_of_route(route, position)
        belief = self._belief
        if self._far is not None and prescribed is None:
            faults += self._look_far(known, position)
            if self._far_belief is not None:
                belief = self._far_belief if belief is None else belief.over(self._far_belief)
        half_width = self.car.body.half_width
        cost = CostMap.build(known, belief, half_width, prescribed, self._stuck)
        if self._frontiers is not None and prescribed is None:
            try:
                cost = with_frontiers(cost, known, position, self.goal, self._frontiers)
            except Exception:
                # A plug-in may raise anything. The route is then chosen without it.
                faults += (Fault.FRONTIERS_FAILED,)
        return _Costs(cost, prescribed, faults)

    def _look_far(self, known: OccupancyGrid, position: tuple[float, float]) -> tuple[Fault, ...]:
        """Ask for a far prediction and remember it; return the faults that were handled."""
        assert self._far is not None
        coarse = coarse_map(known.crop(known.frame.square(*position, SIDE)))
        patience, self._patience = max(self._patience, self._deadline), 0.0
        try:
            prediction = self._far.ask(View(coarse, np.array([*position, 0.0])), patience)
        except (LateError, BadPredictionError):
            return (Fault.FAR_FAILED,)
        self._far_belief = remember_far(self._far_belief, known.frame, prediction)
        return ()

    def _plan(
        self,
        tick: int,
        state: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        costs: _Costs,
    ) -> Path | None:
        """Return a path from a state, or None if the car should keep the one it has."""
        position, speed = (float(state[0]), float(state[1])), float(state[3])
        cost, prescribed = costs.map, costs.prescribed
        route = self._find_route(costs, position)
        if route is None:
            return None
        pose = np.array([*position, np.remainder(state[2] + np.pi, 2 * np.pi) - np.pi])
        line = self.config.line
        if prescribed is not None:
            line = replace(line, tether=PRESCRIBED_TETHER)
        smoother = Smoother(cost, risk, self.goal, self.car, line)
        fresh = smoother.along(Path.through(route, "route").points, pose, "route")
        present = self._present_path(smoother, pose)
        if fresh is None and present is None:
            seed = self.seed * 100_003 + tick
            path = self._hybrid_path(cost, known, pose)
            path = path or self._ompl_path(cost, risk, pose, route, seed)
            if path is not None:
                return smoother.along(path.points, pose, path.source) or path
            # The car cannot drive the corners of a polyline. Until it is slow it keeps its present
            # path, whose end leaves room to turn.
            return (
                None if self.path is not None and speed > 0.3 else Path.through(route, "dijkstra")
            )
        if fresh is None or present is None:
            return fresh or present
        prices = [smoother.price(path, speed) for path in (fresh, present)]
        # This preference for the present path keeps the car from switching back and forth.
        return fresh if prices[0] < self.config.better * prices[1] else present

    def _find_route(
        self, costs: _Costs, position: tuple[float, float]
    ) -> NDArray[np.float64] | None:
        """Return a route (n, 2) [m] to the goal, along the prescribed one if there is one."""
        route = None
        if costs.prescribed is not None:
            route = self._join_prescribed(costs.prescribed, costs.map, position)
        return find_route(costs.map, position, self.goal) if route is None else route

    def _present_path(self, smoother: Smoother, pose: NDArray[np.float64]) -> Path | None:
        """Return the present path, smoothed again from a pose; None if it can no longer be used."""
        path = self._whole
        if path is None or path is not self.path or path.source == "dijkstra":
            return None
        x, y = float(pose[0]), float(pose[1])
        here, _, square = project(path.points, x, y, self.segment - 5, self.segment + 30)
        left = path.points[here:]
        # A path whose rest does not pass the goal leads on from it, and not back to it.
        missed = np.hypot(*(left - np.array(self.goal)).T).min() > PATH_GOAL_RADIUS
        if square > 0.4**2 or len(left) < 8 or missed:
            return None
        return smoother.along(left, pose, path.source)

    def _ompl_path(
        self,
        cost: CostMap,
        risk: RiskMap,
        pose: NDArray[np.float64],
        route: NDArray[np.float64],
        seed: int,
    ) -> Path | None:
        """Return the first path that OMPL finds along a route, with decreasing reach, or None."""
        search = self.config.search
        # The last try uses the car's tightest turns.
        tries = [(ahead, search) for ahead in self.config.ahead]
        tries.append((self.config.ahead[-2], replace(search, slack=1.01)))
        for ahead, settings in tries:
            path = plan_path(cost, risk, pose, route, ahead, self.car, settings, seed)
            if path is not None:
                return path
        return None

    def _hybrid_path(
        self, cost: CostMap, known: OccupancyGrid, pose: NDArray[np.float64]
    ) -> Path | None:
        """Return a path along forward arcs from hybrid A*, and then along the route, or None."""
        c, forward = self.config, replace(self.car, reverse=0.0)
        legs = find_legs(cost, known, pose, self.goal, c.onward, self._stuck, forward, c.hybrid)
        return self._onward(cost, legs[0]) if legs else None

    def _onward(self, cost: CostMap, leg: Leg) -> Path:
        """Return a path along a leg, and along the route from the leg's end to the goal."""
        arcs = Path.through(leg.poses[:, :2], "hybrid")
        end = arcs.points[-1]
        rest = find_route(cost, (float(end[0]), float(end[1])), self.goal)
        points = arcs.points if rest is None else np.vstack([arcs.points, rest[1:]])
        return replace(Path.through(points, "hybrid"), drivable=len(arcs.points))

    def _rest_of_route(
        self, route: NDArray[np.float64], position: tuple[float, float]
    ) -> NDArray[np.float64]:
        """Return the rest of the prescribed route, (n, 2), and remember where on it the car is."""
        last, reach = self._route_segment, round(self.config.join / POINT_SPACING) + 10
        at, _, square = project(route, *position, last - 10, last + reach)
        # A part of the route that is farther away may lie behind a wall: it is not reached yet.
        if square < self.config.beside**2:
            self._route_segment = at
        return route[self._route_segment :]

    def _join_prescribed(
        self, prescribed: NDArray[np.float64], cost: CostMap, position: tuple[float, float]
    ) -> NDArray[np.float64] | None:
        """Return a route (n, 2) that joins the prescribed one some metres ahead, or None."""
        # By a search, since the straight line to the joining point may lead through a wall.
        last = min(round(self.config.join / POINT_SPACING), len(prescribed) - 1)
        join = float(prescribed[last, 0]), float(prescribed[last, 1])
        route = find_route(cost, position, join)
        return None if route is None else np.vstack([route, prescribed[last + 1 :]])


def _leads_back(before: Path, segment: int, path: Path) -> bool:
    """Return whether a path leads back, compared with the rest of the one before it.

    It does if the ways along both, of `BACK_LENGTH` at most, differ in direction by more than 120°.
    """
    count = round(BACK_LENGTH / POINT_SPACING)
    old, new = before.points[segment:][: count + 1], path.points[: count + 1]
    if len(old) < 2:
        return False
    was, now = old[-1] - old[0], new[-1] - new[0]
    return float(was @ now) < -0.5 * float(np.hypot(*was) * np.hypot(*now))
