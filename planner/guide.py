"""The guide: keeps a path to the goal at hand, planned beside the control loop."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.costmap import Belief, CostMap, remember
from planner.dynamics import CarLimits
from planner.hybrid import HybridConfig, find_legs
from planner.line import LineConfig, curvatures, smooth_line, speeds
from planner.path import PathConfig, plan_path
from planner.reference import SPACING, Path, project
from planner.risk import RiskMap
from planner.route import find_route
from predictor import OccupancyGrid, Prediction


@dataclass(frozen=True)
class GuideConfig:
    """When paths are planned and adopted.

    Attributes:
        every: ticks from one request to the next while nothing is wrong.
        delay: ticks from a request to the adoption of its path: what the search may take.
        ahead: how far along the route OMPL's curves reach [m]; where none is found, how far next.
        better: a new path replaces one that still serves if it costs less than this share.
        reserve: a path serves as long as this much of its drivable part is ahead [m].
        join: how far ahead a given way is joined [m].
        beside: so near to a given way the car has come along it [m].
        turning_room: how far before a path meets an obstacle it ends until there is another [m].
        search: settings of the search itself.
        line: settings of the line along the path.
    """

    every: int = 8
    delay: int = int(__import__('os').environ.get('DELAY', 1))
    ahead: tuple[float, ...] = (9.0, 5.0, 3.0)
    better: float = 0.95
    reserve: float = 5.0
    join: float = 12.0
    beside: float = 1.0
    turning_room: float = 1.2
    search: PathConfig = field(default_factory=PathConfig)
    line: LineConfig = field(default_factory=LineConfig)


class Guide:
    """Requests paths, adopts each a fixed number of ticks later, and says where the car is.

    OMPL's path is what the car follows; the route that Dijkstra found stands in, and is counted,
    where OMPL found none. Planning time is measured apart from the control cycle's.

    Args:
        goal: x, y [m].
        waypoints: (n, 2) a route given as the task, followed in place of one of our own.
        car: what it can do; its body.
        config: settings.
        seed: of the search.
    """

    def __init__(
        self,
        goal: tuple[float, float],
        waypoints: NDArray[np.float64] | None,
        car: CarLimits,
        config: GuideConfig,
        seed: int,
    ) -> None:
        self.goal, self.car, self.config, self.seed = goal, car, config, seed
        self._given = None if waypoints is None else Path.through(waypoints, "given").points
        self._given_at = 0
        self.path: Path | None = None
        self._whole: Path | None = None
        self._belief: Belief | None = None
        self.segment = 0
        self.is_new = False
        self.counts: Counter[str] = Counter()
        self.plan_ms = 0.0
        self._pending: tuple[int, Path] | None = None
        self._requested = -(10**9)

    def update(
        self,
        tick: int,
        state: NDArray[np.float64],
        risk: RiskMap,
    ) -> None:
        """Advance by a tick: adopt a path that is due, and end it before what blocks it.

        Args:
            tick: number of this tick.
            state: x, y, yaw, v now, (4,).
            risk: the newest map around the car.
        """
        self.is_new = False
        if self._pending is not None and tick >= self._pending[0]:
            self._whole, self._pending = self._pending[1], None
            self.segment = 0
            self.is_new = True
            self.counts[self._whole.source] += 1
        if self._whole is not None:
            # A new path starts where the car was expected to be: near its first metres.
            reach = 40 if self.is_new else 15
            self.segment, _, _ = project(
                self._whole.points, state[0], state[1], self.segment - 5, self.segment + reach
            )
            self.path = self._unblocked(self._whole, risk)

    def request(
        self,
        tick: int,
        ahead: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
    ) -> None:
        """Plan a path if one is due; it is adopted `delay` ticks from now.

        Args:
            tick: number of this tick.
            ahead: the states the car is going to be in, from now on, (n, 4).
            known: what has been seen.
            risk: the newest map around the car.
            steering: a prediction that may move the route, or None.
        """
        self.plan_ms = 0.0
        urgent = self.path is not self._whole or ahead[:, 3].max() < 0.2
        overdue = tick - self._requested >= self.config.every
        if self._pending is None and (overdue or (urgent and tick - self._requested >= 3)):
            self._requested = tick
            at = min(self.config.delay if self.path is not None else 0, len(ahead) - 1)
            started = time.perf_counter()
            path = self._plan(tick, ahead[at], known, risk, steering)
            self.plan_ms = 1e3 * (time.perf_counter() - started)
            if path is not None:
                self._pending = (tick + (self.config.delay if self.path is not None else 0), path)

    def _unblocked(self, path: Path, risk: RiskMap) -> Path:
        """The path, or the part of it that ends with room to turn before an obstacle."""
        coming = path.points[self.segment : self.segment + 100]
        cells = np.floor((coming - np.array(risk.frame.origin)) / risk.frame.resolution).astype(int)
        inside = ((cells >= 0) & (cells < np.array(risk.frame.shape[::-1]))).all(axis=1)
        cells = cells[inside]
        blocked = risk.obstacle_distance[cells[:, 1], cells[:, 0]] < self.car.body.half_width + 0.02
        if not blocked.any():
            return path
        first = self.segment + int(np.flatnonzero(inside)[np.argmax(blocked)])
        end = max(first - round(self.config.turning_room / SPACING), self.segment + 2)
        return Path(path.points[:end], path.source)

    def _plan(
        self,
        tick: int,
        state: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
    ) -> Path | None:
        if steering is not None:
            self._belief = remember(self._belief, known.frame, steering)
        position = (float(state[0]), float(state[1]))
        way = None if self._given is None else self._still_to_go(self._given, position)
        cost = CostMap.build(known, self._belief, self.car.body.half_width, way)
        route = None if way is None else self._along(way, cost, position)
        if route is None:
            route = find_route(cost, position, self.goal)
        if route is None:
            self.counts["no_route"] += 1
            return None
        pose = np.array([state[0], state[1], np.remainder(state[2] + np.pi, 2 * np.pi) - np.pi])
        fresh = self._smoothed(Path.through(route, "dijkstra").points, pose, state[3], cost, risk)
        import os
        if fresh is None or os.environ.get("ALWAYS"):
            if os.environ.get("WAY", "hybrid") == "hybrid":
                found = self._searched(cost, known, pose)
            else:
                found = self._sampled(cost, risk, pose, route, self.seed * 100_003 + tick)
            if found is not None:
                other = self._smoothed(found.points, pose, state[3], cost, risk)
                self.counts["tried"] += 1
                if other is not None:
                    self.counts["smoothed"] += 1
                other = other or found
                if fresh is not None:
                    prices = [self._price(path, state[3], cost) for path in (fresh, other)]
                    if prices[0] < prices[1]:
                        other = fresh
                fresh = other
        if fresh is None:
            # The car cannot drive a polyline's corners. It is better off at the end of the path
            # that it has, which leaves it room to turn, as long as it has not come to rest there.
            self.counts["not_found"] += 1
            if self.path is not None and state[3] > 0.3:
                return None
            return Path.through(route, "dijkstra")
        kept = self._kept(pose, state[3], cost, risk)
        if kept is None:
            return fresh
        prices = [self._price(path, state[3], cost) for path in (fresh, kept)]
        return fresh if prices[0] < self.config.better * prices[1] else kept

    def _sampled(
        self,
        cost: CostMap,
        risk: RiskMap,
        pose: NDArray[np.float64],
        route: NDArray[np.float64],
        seed: int,
    ) -> Path | None:
        """OMPL's path along a route, as far along it as it finds one."""
        search = self.config.search
        # Last, as tight as the car can turn.
        tries = [(ahead, search) for ahead in self.config.ahead]
        tries.append((self.config.ahead[-2], replace(search, slack=1.01)))
        for ahead, settings in tries:
            found = plan_path(cost, risk, pose, route, ahead, self.car, settings, seed)
            if found is not None:
                return found
        return None

    def _searched(
        self, cost: CostMap, known: OccupancyGrid, pose: NDArray[np.float64]
    ) -> Path | None:
        """A path of arcs, and the route from its end."""
        forward = replace(self.car, reverse=0.0)
        legs = find_legs(cost, known, pose, self.goal, 6.0, forward, HybridConfig(nodes=20000))
        if not legs:
            return None
        points = legs[0].poses[:, :2]
        rest = find_route(cost, (points[-1, 0], points[-1, 1]), self.goal)
        path = Path.through(points, "ompl")
        count = len(path.points)
        if rest is not None:
            path = Path.through(np.vstack([path.points, rest[1:]]), "ompl")
        return replace(path, drivable=count)

    def _kept(
        self, pose: NDArray[np.float64], speed: float, cost: CostMap, risk: RiskMap
    ) -> Path | None:
        """The path at hand, smoothed anew from a pose; None where it no longer serves."""
        path = self._whole
        if path is None or path is not self.path or path.source != "ompl":
            return None
        here, _, square = project(path.points, *pose[:2], self.segment - 5, self.segment + 30)
        left = path.points[here:]
        # Beyond the goal it leads on, but not back.
        missed = np.hypot(*(left - np.array(self.goal)).T).min() > 0.3
        if square > 0.4**2 or len(left) < 8 or missed:
            return None
        return self._smoothed(left, pose, speed, cost, risk)

    def _run_out(self, way: NDArray[np.float64], cost: CostMap) -> NDArray[np.float64]:
        """A way to the goal, and straight on as far as is free, so that none need brake for it."""
        if len(way) < 6 or math.dist(way[-1], self.goal) > 0.2:
            return way
        heading = way[-1] - way[-6]
        heading /= max(float(np.hypot(*heading)), 1e-9)
        count = math.ceil((self.car.stopping_distance + 0.5) / SPACING)
        on = way[-1] + SPACING * np.arange(1, count + 1)[:, None] * heading
        cells = np.floor((on - np.array(cost.frame.origin)) / cost.frame.resolution).astype(int)
        inside = ((cells >= 0) & (cells < np.array(cost.frame.shape[::-1]))).all(axis=1)
        cols, rows = np.where(inside[:, None], cells, 0).T
        free = inside & (cost.room[rows, cols] >= cost.required + 0.1)
        return np.vstack([way, on[: count if free.all() else int(np.argmin(free))]])

    def _smoothed(
        self,
        way: NDArray[np.float64],
        pose: NDArray[np.float64],
        speed: float,
        cost: CostMap,
        risk: RiskMap,
    ) -> Path | None:
        """The fastest line along a way that the car can drive, and the rest of the way."""
        way = self._run_out(way, cost)
        lines = smooth_line(way, pose, speed, cost.room, cost.frame.resolution, cost.frame.origin,
                            cost.unsure, self.goal, self.car, self.config.line)  # fmt: skip
        for _, line in lines:
            if self._drivable(line, cost, risk):
                path = Path.through(np.vstack([line, way[len(line) :]]), "ompl")
                return replace(path, drivable=min(len(line), len(path.points)))
        return None

    def _drivable(self, line: NDArray[np.float64], cost: CostMap, risk: RiskMap) -> bool:
        if np.abs(curvatures(line)).max() > self.car.max_curvature:
            return False
        steps = np.diff(line, axis=0)
        steps /= np.hypot(*steps.T)[:, None]
        ends = self.car.body.length / 4
        # The car may start closer to something than it likes; it must be able to leave.
        start = np.hypot(*(line[1:] - line[0]).T) < 0.45
        for side in (-ends, ends):
            points = line[1:] + side * steps
            if not (start | self._fits(points, cost, risk)).all():
                return False
        return True

    def _fits(
        self, points: NDArray[np.float64], cost: CostMap, risk: RiskMap
    ) -> NDArray[np.bool_]:
        around = math.hypot(self.car.body.length / 4, self.car.body.half_width) + 0.02
        cells = np.floor((points - np.array(cost.frame.origin)) / cost.frame.resolution).astype(int)
        inside = ((cells >= 0) & (cells < np.array(cost.frame.shape[::-1]))).all(axis=1)
        out = np.ones(len(points), dtype=bool)
        cols, rows = cells[inside].T
        out[inside] = cost.clearance[rows, cols] >= cost.required
        cells = np.floor((points - np.array(risk.frame.origin)) / risk.frame.resolution).astype(int)
        inside = ((cells >= 0) & (cells < np.array(risk.frame.shape[::-1]))).all(axis=1)
        cols, rows = cells[inside].T
        out[inside] = risk.obstacle_distance[rows, cols] >= around
        return out

    def _price(self, path: Path, speed: float, cost: CostMap) -> float:
        """What a path costs: metres at top speed, times what a metre of each place costs."""
        car, points = self.car, path.points
        head = points[: max(2, min(path.drivable or 120, len(points)))]
        v = speeds(head, max(speed, 0.5), car.v_max, car.acceleration, car.braking, car.planned_cornering)
        slowness = np.ones(len(points))
        slowness[: len(head)] = car.v_max / np.maximum(v, 0.5)
        return cost.along(points, slowness)

    def _still_to_go(
        self, given: NDArray[np.float64], position: tuple[float, float]
    ) -> NDArray[np.float64]:
        """The part of the given way that is left, (n, 2); notes how far the car has come."""
        reach = round(self.config.join / SPACING) + 10
        at, _, square = project(given, *position, self._given_at - 10, self._given_at + reach)
        # What is farther away may lie behind a wall, and is yet to be reached.
        if square < self.config.beside**2:
            self._given_at = at
        return given[self._given_at :]

    def _along(
        self, way: NDArray[np.float64], cost: CostMap, position: tuple[float, float]
    ) -> NDArray[np.float64] | None:
        """A route (n, 2) that joins a way some metres ahead and follows it to its end.

        It is searched for, for the straight line to the way may lead through a wall; None where
        there is none.
        """
        last = min(round(self.config.join / SPACING), len(way) - 1)
        route = find_route(cost, position, (float(way[last, 0]), float(way[last, 1])))
        return None if route is None else np.vstack([route, way[last + 1 :]])
