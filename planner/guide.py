"""The guide: keeps a path to the goal at hand, planned beside the control loop."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.costmap import Belief, CostMap, remember
from planner.dynamics import CarLimits
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
    """

    every: int = 8
    delay: int = 2
    ahead: tuple[float, ...] = (9.0, 5.0, 3.0)
    better: float = 0.9
    reserve: float = 5.0
    join: float = 12.0
    beside: float = 1.0
    turning_room: float = 1.2
    search: PathConfig = field(default_factory=PathConfig)


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
            at = min(self.config.delay, len(ahead) - 1)
            started = time.perf_counter()
            path = self._plan(tick, ahead[at], known, risk, steering)
            self.plan_ms = 1e3 * (time.perf_counter() - started)
            if path is not None:
                self._pending = (tick + self.config.delay, path)

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
        # A way that is the task is not moved by what is believed beside it.
        if steering is not None and self._given is None:
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
        seed = self.seed * 100_003 + tick
        search = self.config.search
        # Last, as tight as the car can turn.
        tries = [(ahead, search) for ahead in self.config.ahead]
        tries.append((self.config.ahead[-2], replace(search, slack=1.01)))
        for ahead, settings in tries:
            found = plan_path(cost, risk, pose, route, ahead, self.car, settings, seed)
            if found is not None:
                break
        if found is None:
            # The car cannot drive a polyline's corners. It is better off at the end of the path
            # that it has, which leaves it room to turn, as long as it has not come to rest there.
            self.counts["not_found"] += 1
            if self.path is not None and state[3] > 0.3:
                return None
            found = Path.through(route, "dijkstra")
        return None if self._still_serves(cost, position, found) else found

    def _still_serves(self, cost: CostMap, position: tuple[float, float], found: Path) -> bool:
        """Whether to go on along the path at hand: a car that keeps changing its mind orbits."""
        path = self._whole
        if path is None or path is not self.path or path.source != "ompl":
            return False
        here, _, square = project(path.points, *position, self.segment - 5, self.segment + 30)
        last = len(path.points) - 1
        short = path.drivable < last and (path.drivable - here) * SPACING < self.config.reserve
        if short or square > 0.4**2 or here >= last - 1:
            return False
        return cost.along(found.points) > self.config.better * cost.along(path.points[here:])

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
