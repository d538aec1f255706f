"""The guide: request paths to the goal, adopt what is found, and track the car on it."""

from __future__ import annotations

import math
from collections import Counter
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.frontiers import FrontierPredictor
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import REST
from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.guide.elastic_band import BODY_MARGIN
from planner.guide.guide_config import GuideConfig
from planner.guide.in_order import InOrder
from planner.guide.path_search import Found, PathSearch, Request, SearchMemory, front
from planner.guide.turn import longest_turn, rate_towards
from planner.motion.path import POINT_SPACING, Path, project
from planner.motion.plan import mirrored
from planner.risk.risk_map import RiskMap

BACK_LENGTH = 4.0
"""Length of the way by whose direction a path leads back or not [m]."""
SAME_PLACE = 0.01
"""Distance below which two places where the car got stuck are one [m]."""


class Leg(NamedTuple):
    """What a `Guide` follows: path, segment and gear, and the legs of a recovery manoeuvre."""

    gear: int
    legs: tuple[tuple[int, Path], ...]
    on_leg: bool
    path: Path | None
    whole: Path | None
    segment: int


class Guide:
    """Requests paths, adopts each some ticks later, and tracks the car on them.

    An executor runs the searches, one at a time: in the order of the calls, or beside the caller.
    A path is adopted in the first tick in which it is ready, at least `GuideConfig.delay` ticks
    after its request; meanwhile the car goes on along the last one.

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
        executor: runs the searches; None: they run in the order of the calls.

    Attributes:
        search: search for paths.
        path: path to follow, up to an obstacle on it; None: there is none yet.
        segment: index of the path's segment near which the car is.
        is_new: whether the path was adopted in this tick.
        counts: number of paths adopted, by source, of those that lead back ("reversal"), and of
            recovery manoeuvres.
        search_ms: duration of the searches that ended in this tick [ms].
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
        executor: Executor | None = None,
    ) -> None:
        route = None if waypoints is None else Path.through(waypoints, "given").points
        self.search = PathSearch(goal, route, car, config, seed, frontiers)
        self.car, self.config = car, config
        self._executor = executor or InOrder()
        self._running: Future[Found] | None = None
        self._memory = SearchMemory()
        self.path: Path | None = None
        self._whole: Path | None = None
        self.segment = 0
        self.is_new = False
        self.counts: Counter[str] = Counter()
        self.search_ms = 0.0
        self.gear = 1
        self._pending: tuple[int, Path] | None = None
        self._requested = -(10**9)
        self._legs: list[tuple[int, Path]] = []
        self.on_leg = False
        self.turn_to: float | None = None
        self._turn_ticks: int | None = None
        self._stuck = np.empty((0, 2))

    def towards(self, goal: tuple[float, float]) -> Guide:
        """Return a guide to another goal, which finds its own route, for a car under way.

        It keeps the gear, what was predicted so far, and where the car got stuck. It has no path
        yet.

        Args:
            goal: x, y of the goal [m].
        """
        search = self.search
        other = Guide(
            goal,
            waypoints=None,
            car=self.car,
            config=self.config,
            seed=search.seed,
            frontiers=search.frontiers,
            executor=self._executor,
        )
        other.gear, other.counts = self.gear, self.counts
        other._memory, other._stuck = replace(self._memory, segment=0), self._stuck
        return other

    def awaits_leg(self, state: NDArray[np.float64]) -> bool:
        """Return whether the car stands where the next leg of a recovery manoeuvre begins.

        A manoeuvre is given up if the car has come away from where it begins.

        Args:
            state: current x, y, yaw, v of the car, (4,).
        """
        if not self._legs:
            return False
        points = self._legs[0][1].points
        is_there = math.dist(points[-1 if self.on_leg else 0], state[:2]) <= self.config.leg_end
        if not is_there and not self.on_leg:
            self._legs = []
        return is_there and abs(state[3]) <= REST

    def leg(self) -> Leg:
        """Return what is followed at present, for `recall`."""
        return Leg(self.gear, tuple(self._legs), self.on_leg, self.path, self._whole, self.segment)

    def recall(self, leg: Leg) -> None:
        """Go back to what was followed when `leg` was called; a turn since then is given up."""
        self.gear, legs, self.on_leg, self.path, self._whole, self.segment = leg
        self._legs, self.turn_to = list(legs), None

    def begin_leg(self) -> None:
        """Begin the next leg of a recovery manoeuvre, in its gear."""
        if self.on_leg:
            del self._legs[0]
        self.gear, path = self._legs[0]
        self._adopt(path)
        self.on_leg = len(self._legs) > 1
        # The last leg is an ordinary path.
        if not self.on_leg:
            self._legs = []

    def turn_rate(
        self, state: NDArray[np.float64], risk: RiskMap
    ) -> tuple[float, tuple[Fault, ...]]:
        """Return the yaw rate of the turn on the spot under way, and the faults.

        A turn that takes much longer than it should has failed, since the car does not obey.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            risk: newest risk map around the car.

        Returns:
            The yaw rate [rad/s]; 0: there is no turn.
        """
        if self.turn_to is None:
            return 0.0, ()
        if self._turn_ticks is None:
            angle = math.remainder(self.turn_to - float(state[2]), 2.0 * math.pi)
            self._turn_ticks = longest_turn(angle, self.car)
        self._turn_ticks -= 1
        has_failed = self._turn_ticks < 0
        rate = 0.0 if has_failed else rate_towards(self.turn_to, state, risk, self.car)
        if rate == 0.0:
            # A path is due at once.
            self.turn_to, self._requested = None, -(10**9)
        return rate, (Fault.TURN_FAILED,) if has_failed else ()

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
        """Request a path if one is due, to be adopted `delay` ticks from now, or later.

        Args:
            tick: number of this tick.
            ahead: states of the car's plan, the current one first, (n, 4).
            known: observed map.
            risk: newest risk map around the car.
            steering: prediction that may change the route, or None.

        Returns:
            The faults that were handled. If the search fails, the guide keeps its path.
        """
        if self._legs or self.gear < 0 or self._is_held():
            return ()
        urgent = self.path is not self._whole or ahead[:, 3].max() < 0.2
        overdue = tick - self._requested >= self.config.every
        due = self._pending is None and (overdue or (urgent and tick - self._requested >= 3))
        if not due or self._running is not None:
            return ()
        self._requested = tick
        begin = ahead[min(self._delay, len(ahead) - 1)]
        return self._start(self._request(tick, False, ahead[0], begin, known, risk, steering))

    def unstick(
        self,
        tick: int,
        state: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
        then: float,
    ) -> tuple[Fault, ...]:
        """Request a recovery manoeuvre for a car at rest, in both gears if it has two.

        A car that can turn on the spot turns towards its route, if there is room.

        Args:
            tick: number of this tick.
            state: current x, y, yaw, v of the car, mirrored in reverse, (4,).
            known: observed map.
            risk: newest risk map around the car.
            steering: prediction that may change the route, or None.
            then: speed that the car is to have after this tick [m/s].

        Returns:
            The faults that were handled. If the search fails, the guide keeps its path.
        """
        if self._running is not None:
            return ()
        pose = state if self.gear > 0 else mirrored(state)
        return self._start(self._request(tick, True, pose, pose, known, risk, steering), then)

    def take(self, state: NDArray[np.float64], then: float = 0.0) -> tuple[Fault, ...]:
        """Take over what the search has found, if it has ended.

        Args:
            state: current x, y, yaw, v of the car, (4,).
            then: speed that the car is to have after this tick [m/s].

        Returns:
            The faults that were handled.
        """
        if self._running is None or not self._running.done():
            return ()
        running, self._running = self._running, None
        try:
            found = running.result()
        except Exception:
            # The process of the search has ended. The car goes on along its last path.
            return (Fault.PATH_FAILED,)
        self._memory = found.memory
        self.search_ms += found.ms
        request = found.request
        speed = max(abs(float(state[3])), then)
        halt = speed**2 / (2.0 * self.car.braking)
        if (
            request.recovers
            and math.dist(state[:2], request.state[:2]) + halt > self.config.leg_end
        ):
            # The car comes away without the manoeuvre, which begins where it was.
            return found.faults
        if found.turn_to is not None and (speed if self.gear < 0 else abs(state[3])) > REST:
            # The car drives again. It turns, and changes its gear, only where it stands.
            return found.faults
        if request.recovers and (found.legs is not None or found.turn_to is not None):
            place = front(request.state, self.car)
            # Each search pays for each of them, and a car that stays stuck asks again and again.
            if not (np.hypot(*(self._stuck - place).T) < SAME_PLACE).any():
                self._stuck = np.vstack([self._stuck, place])
        if found.turn_to is not None:
            self.turn_to, self.gear, self.on_leg = found.turn_to, 1, False
            self._turn_ticks = None
            self._legs, self._pending, self.path, self._whole = [], None, None, None
            self.counts["turn"] += 1
        elif found.legs is not None:
            self._legs, self._requested = found.legs, request.tick
            self.on_leg, self._pending = False, None
            self.counts["manoeuvre"] += bool(self._legs)
        elif found.path is not None:
            self._pending = (request.tick + self._delay, found.path)
        return found.faults

    @property
    def _delay(self) -> int:
        """Number of ticks from a request to the adoption of its path, at least."""
        # A car without a path stands: its path can begin at the present state.
        return 0 if self.path is None else self.config.delay

    def _request(
        self,
        tick: int,
        recovers: bool,
        state: NDArray[np.float64],
        begin: NDArray[np.float64],
        known: OccupancyGrid,
        risk: RiskMap,
        steering: Prediction | None,
    ) -> Request:
        """Return a request; the arguments are described there."""
        return Request(
            tick=tick,
            recovers=recovers,
            state=state,
            begin=begin,
            # The next scan changes the map while the search runs.
            known=known.copy(),
            risk=risk,
            steering=steering,
            stuck=self._stuck,
            path=self.path,
            is_clear=self.path is self._whole,
            segment=self.segment,
            memory=self._memory,
        )

    def _start(self, request: Request, then: float = 0.0) -> tuple[Fault, ...]:
        """Start a search, and take over what it finds if it ends at once, see `take`."""
        try:
            self._running = self._executor.submit(self.search.find, request)
        except Exception:
            # No process could be started.
            return (Fault.PATH_FAILED,)
        return self.take(request.state, then)

    def _adopt(self, path: Path) -> None:
        self._whole, self.segment, self.is_new = path, 0, True
        self.counts[path.source] += 1

    def _is_held(self) -> bool:
        """Return whether the car must complete a path of hybrid A* before it replans.

        The path counts up to the end of its drivable part, also where it was smoothed again.
        Replanning as soon as the arcs end was tried, and saved no time for certain.
        """
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
