"""The path search: find a path, a recovery manoeuvre or a turn for what was known at a time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.frontiers import FrontierPredictor
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import REST
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.guide.guide_config import GuideConfig
from planner.guide.hybrid_astar import Leg, find_legs
from planner.guide.ompl_search import plan_path
from planner.guide.route import find_route
from planner.guide.smoothing import Smoother
from planner.guide.subgoals import with_frontiers
from planner.guide.turn import angle_to, can_turn
from planner.motion.goal import PATH_GOAL_RADIUS
from planner.motion.path import POINT_SPACING, Path, project
from planner.risk.cost_map import Belief, CostMap, remember
from planner.risk.risk_map import RiskMap

PRESCRIBED_TETHER = 8.0
"""Weight of the squared distance from a prescribed route, in unobserved cells [1/m²].

A line that cuts the route's corners there may lead towards a wall, observed too late to turn."""

TURN_FROM, TURN_FROM_STUCK = 1.2, 0.4
"""Angle between the heading and the route from which a car at rest turns on the spot, and the same
for a car that is stuck [rad]."""


@dataclass(frozen=True)
class SearchMemory:
    """What one search leaves to the next.

    Attributes:
        belief: what was predicted so far; None: nothing.
        segment: index of the segment of the prescribed route that the car has reached.
    """

    belief: Belief | None = None
    segment: int = 0


@dataclass(frozen=True, eq=False)
class Request:
    """What is known when a search begins; nothing changes it while the search runs.

    Attributes:
        tick: number of the tick.
        recovers: whether a recovery manoeuvre is wanted, not a path.
        state: current x, y, yaw, v of the car, (4,) [m, m, rad, m/s].
        begin: x, y, yaw, v where the path begins, (4,).
        known: observed map.
        risk: newest risk map around the car.
        steering: prediction that may change the route, or None.
        stuck: places at which the car got stuck, (k, 2) [m].
        path: path under way, up to an obstacle; None: there is none.
        is_clear: whether there is no obstacle on that path.
        segment: index of the segment of that path near which the car is.
        memory: what the search before has left.
    """

    tick: int
    recovers: bool
    state: NDArray[np.float64]
    begin: NDArray[np.float64]
    known: OccupancyGrid
    risk: RiskMap
    steering: Prediction | None
    stuck: NDArray[np.float64]
    path: Path | None
    is_clear: bool
    segment: int
    memory: SearchMemory


@dataclass(frozen=True, eq=False)
class Found:
    """What a search has found.

    Attributes:
        request: request that it answers.
        memory: what it leaves to the next search.
        faults: faults that were handled.
        path: path; None: the car keeps the one it has.
        legs: gear and path of each leg of a recovery manoeuvre; None: the search failed.
        turn_to: yaw at which a turn on the spot ends, in place of a path or manoeuvre [rad]; None:
            the car does not turn.
        ms: duration of the search [ms].
    """

    request: Request
    memory: SearchMemory
    faults: tuple[Fault, ...] = ()
    path: Path | None = None
    legs: list[tuple[int, Path]] | None = None
    turn_to: float | None = None
    ms: float = 0.0


class _Costs(NamedTuple):
    """What a search for a path minimises.

    Attributes:
        map: cost map.
        prescribed: rest of the prescribed route, (n, 2) [m]; None: the search finds a route.
    """

    map: CostMap
    prescribed: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class PathSearch:
    """Searches for paths and recovery manoeuvres.

    It keeps nothing from one search to the next, so that a search may run in a thread or a process.

    Attributes:
        goal: x, y of the goal [m].
        route: points of a prescribed route, `POINT_SPACING` apart, (n, 2) [m]; None: the search
            finds a route.
        car: the car's limits and body.
        config: settings.
        seed: seed of OMPL's samples.
        frontiers: predictor of frontiers, by which a route that is not prescribed is chosen, or
            None.
    """

    goal: tuple[float, float]
    route: NDArray[np.float64] | None
    car: CarLimits
    config: GuideConfig
    seed: int
    frontiers: FrontierPredictor | None = None

    def find(self, request: Request) -> Found:
        """Return what a search finds; if it fails in any way, that is one of its faults."""
        started = time.perf_counter()
        memory, faults = request.memory, list[Fault]()
        try:
            memory = self._remembered(request)
            costs = self._costs(request, memory, faults)
            found = Found(request, memory, turn_to=self._turn(request, costs))
            if found.turn_to is None and request.recovers:
                found = replace(found, legs=self._manoeuvre(request, costs))
            elif found.turn_to is None:
                found = replace(found, path=self._path(request, costs))
        except Exception:
            # OMPL may raise anything. Without a new path the car goes on along the last one.
            found = Found(request, memory)
            faults.append(Fault.PATH_FAILED)
        return replace(found, faults=tuple(faults), ms=1e3 * (time.perf_counter() - started))

    def _remembered(self, request: Request) -> SearchMemory:
        """Return the memory with the newest prediction and the place on the prescribed route."""
        memory, frame = request.memory, request.known.frame
        if request.steering is not None:
            memory = replace(memory, belief=remember(memory.belief, frame, request.steering))
        if self.route is None:
            return memory
        last, reach = memory.segment, round(self.config.join / POINT_SPACING) + 10
        x, y = request.begin[:2].tolist()
        at, _, square = project(self.route, x, y, last - 10, last + reach)
        # A part of the route that is farther away may lie behind a wall: it is not reached yet.
        return replace(memory, segment=at) if square < self.config.beside**2 else memory

    def _costs(self, request: Request, memory: SearchMemory, faults: list[Fault]) -> _Costs:
        """Return the cost map, and the rest of the prescribed route if there is one.

        Faults that are handled are added to the list.
        """
        known, begin = request.known, request.begin
        prescribed = None if self.route is None else self.route[memory.segment :]
        half_width = self.car.body.half_width
        cost = CostMap.build(known, memory.belief, half_width, prescribed, request.stuck)
        if self.frontiers is not None and prescribed is None:
            position = (float(begin[0]), float(begin[1]))
            try:
                cost = with_frontiers(cost, known, position, self.goal, self.frontiers)
            except Exception:
                # A plug-in may raise anything. The route is then chosen without it.
                faults.append(Fault.FRONTIERS_FAILED)
        return _Costs(cost, prescribed)

    def _turn(self, request: Request, costs: _Costs) -> float | None:
        """Return the yaw at which a turn on the spot towards the route ends; None: none is due."""
        state = request.state
        if self.car.turn_rate == 0.0 or abs(state[3]) > REST:
            return None
        route = self._find_route(costs, (float(state[0]), float(state[1])))
        if route is None:
            return None
        angle = angle_to(route, state)
        least = TURN_FROM_STUCK if request.recovers else TURN_FROM
        if abs(angle) < least or not can_turn(state, angle, request.risk, self.car):
            return None
        return float(state[2]) + angle

    def _manoeuvre(self, request: Request, costs: _Costs) -> list[tuple[int, Path]]:
        """Return gear and path of each leg of a recovery manoeuvre; empty if there is none.

        It avoids the places where the car got stuck, and the present one, if it can.
        """
        c, pose, cost = self.config, request.state, costs.map
        stuck = np.vstack([request.stuck, front(pose, self.car)])
        for places in (stuck, stuck[:0]):
            legs = find_legs(
                cost, request.known, pose, self.goal, c.onward, places, self.car, c.hybrid
            )
            if legs:
                break
        paths = [(leg.gear, Path.through(leg.poses[:, :2], "hybrid")) for leg in legs[:-1]]
        return paths + [(leg.gear, self._onward(cost, leg)) for leg in legs[-1:]]

    def _path(self, request: Request, costs: _Costs) -> Path | None:
        """Return a path, or None if the car should keep the one it has."""
        state, risk = request.begin, request.risk
        position, speed = (float(state[0]), float(state[1])), float(state[3])
        cost, prescribed = costs
        route = self._find_route(costs, position)
        if route is None:
            return None
        pose = np.array([*position, np.remainder(state[2] + np.pi, 2 * np.pi) - np.pi])
        line = self.config.line
        if prescribed is not None:
            line = replace(line, tether=PRESCRIBED_TETHER)
        smoother = Smoother(cost, risk, self.goal, self.car, line)
        fresh = smoother.along(Path.through(route, "route").points, pose, "route")
        present = self._present_path(request, smoother, pose)
        if fresh is None and present is None:
            path = self._hybrid_path(request, cost, pose)
            path = path or self._ompl_path(request, cost, pose, route)
            if path is not None:
                return smoother.along(path.points, pose, path.source) or path
            # The car cannot drive the corners of a polyline. Until it is slow it keeps its present
            # path, whose end leaves room to turn.
            keeps = request.path is not None and speed > 0.3
            return None if keeps else Path.through(route, "dijkstra")
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

    def _present_path(
        self, request: Request, smoother: Smoother, pose: NDArray[np.float64]
    ) -> Path | None:
        """Return the present path, smoothed again from a pose; None if it can no longer be used."""
        path = request.path
        if path is None or not request.is_clear or path.source == "dijkstra":
            return None
        x, y, segment = float(pose[0]), float(pose[1]), request.segment
        here, _, square = project(path.points, x, y, segment - 5, segment + 30)
        left = path.points[here:]
        # A path whose rest does not pass the goal leads on from it, and not back to it.
        missed = np.hypot(*(left - np.array(self.goal)).T).min() > PATH_GOAL_RADIUS
        if square > 0.4**2 or len(left) < 8 or missed:
            return None
        return smoother.along(left, pose, path.source)

    def _ompl_path(
        self,
        request: Request,
        cost: CostMap,
        pose: NDArray[np.float64],
        route: NDArray[np.float64],
    ) -> Path | None:
        """Return the first path that OMPL finds along a route, with decreasing reach, or None."""
        seed, search = self.seed * 100_003 + request.tick, self.config.search
        # The last try uses the car's tightest turns.
        tries = [(ahead, search) for ahead in self.config.ahead]
        tries.append((self.config.ahead[-2:][0], replace(search, slack=1.01)))
        for ahead, settings in tries:
            path = plan_path(cost, request.risk, pose, route, ahead, self.car, settings, seed)
            if path is not None:
                return path
        return None

    def _hybrid_path(
        self, request: Request, cost: CostMap, pose: NDArray[np.float64]
    ) -> Path | None:
        """Return a path along forward arcs from hybrid A*, and then along the route, or None."""
        c, forward = self.config, replace(self.car, reverse=0.0)
        legs = find_legs(
            cost, request.known, pose, self.goal, c.onward, request.stuck, forward, c.hybrid
        )
        return self._onward(cost, legs[0]) if legs else None

    def _onward(self, cost: CostMap, leg: Leg) -> Path:
        """Return a path along a leg, and along the route from the leg's end to the goal."""
        arcs = Path.through(leg.poses[:, :2], "hybrid")
        end = arcs.points[-1]
        rest = find_route(cost, (float(end[0]), float(end[1])), self.goal)
        points = arcs.points if rest is None else np.vstack([arcs.points, rest[1:]])
        return replace(Path.through(points, "hybrid"), drivable=len(arcs.points))

    def _join_prescribed(
        self, prescribed: NDArray[np.float64], cost: CostMap, position: tuple[float, float]
    ) -> NDArray[np.float64] | None:
        """Return a route (n, 2) that joins the prescribed one some metres ahead, or None."""
        # By a search, since the straight line to the joining point may lead through a wall.
        last = min(round(self.config.join / POINT_SPACING), len(prescribed) - 1)
        join = float(prescribed[last, 0]), float(prescribed[last, 1])
        route = find_route(cost, position, join)
        return None if route is None else np.vstack([route, prescribed[last + 1 :]])


def front(pose: NDArray[np.float64], car: CarLimits) -> NDArray[np.float64]:
    """Return the middle of the body's front at a pose x, y, yaw (3,) or more, (2,) [m]."""
    ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
    return np.asarray(pose[:2] + car.body.half_length * ahead)
