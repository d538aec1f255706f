"""The pilot: keeps one map over all goals, and says in each tick how fast to drive."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.commands import twist_of
from foresee.mapping.control import Control
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan
from foresee_navigator.mapping import new_map, observe
from foresee_navigator.stopping import stop_after
from planner.navigator import Decision, Navigator, NavigatorConfig
from planner.risk.predictor_process import PredictorProcess

SAME_GOAL = 0.01
"""Distance below which two goals are the same [m]."""


class Mode(StrEnum):
    """What the pilot does."""

    WAITING = "waits for a goal"
    DRIVING = "drives"
    REACHED = "has reached the goal"
    STOPPED = "stops"


@dataclass(frozen=True, eq=False)
class Action:
    """What to do in a tick.

    Attributes:
        mode: what the pilot does.
        speed: speed to command, negative in reverse [m/s].
        yaw_rate: yaw rate to command [rad/s].
        decision: the navigator's decision, with its reasons; None if there was none.
        bad_scan: whether the scan could not be read.
    """

    mode: Mode
    speed: float
    yaw_rate: float
    decision: Decision | None = None
    bad_scan: bool = False


class Pilot:
    """Drives to one goal after the other, and keeps the map.

    Each goal has a `Navigator` of its own, which takes over the map. So does each start after a
    stop, since what was planned before is out of date.

    Args:
        config: settings of the navigators.
        predictor: predictor; None: no predictions.
        resolution: side of a cell of the map [m].
        goal_radius: distance from the goal within which it is reached [m].
        executor: runs the path searches beside the ticks; None: within them.

    Attributes:
        known: observed map; None: nothing was observed.
        goal: x, y of the goal [m]; None: there is none.
    """

    def __init__(
        self,
        config: NavigatorConfig,
        predictor: PredictorProcess | None,
        resolution: float,
        goal_radius: float,
        executor: Executor | None = None,
    ) -> None:
        self.known: OccupancyGrid | None = None
        self.goal: tuple[float, float] | None = None
        self._config, self._predictor, self._executor = config, predictor, executor
        self._resolution, self._goal_radius = resolution, goal_radius
        self._navigator: Navigator | None = None
        self._has_reached = False
        self._stop: list[Control] = []
        self._speed = 0.0

    def head_for(self, goal: tuple[float, float]) -> bool:
        """Take a goal x, y [m], and return whether it is a new one.

        Raises:
            ValueError: if it is not finite.
        """
        if not all(map(math.isfinite, goal)):
            raise ValueError(f"goal is {goal}, it must be finite")
        if self.goal is not None and math.dist(goal, self.goal) < SAME_GOAL:
            return False
        self.goal, self._has_reached, self._navigator = goal, False, None
        return True

    def forget(self) -> None:
        """Begin a new map, since the old one does not fit the poses any more.

        A goal that was not reached stays.
        """
        self.known = self._navigator = None
        self._stop, self._speed = [], 0.0
        if self._has_reached:
            self.goal, self._has_reached = None, False

    def act(self, state: NDArray[np.float64], scan: Scan) -> Action:
        """Return what to do in the next tick.

        Args:
            state: x, y, yaw, v of the car, (4,) [m, m, rad, m/s].
            scan: scan, as seen from that state.

        Raises:
            ValueError: if the state is not finite.
        """
        if self.known is None:
            self.known = new_map(self._config, self._resolution, state)
        if self.goal is not None and math.dist(state[:2], self.goal) <= self._goal_radius:
            self._has_reached = True
        if self.goal is None or self._has_reached:
            bad = not observe(self.known, scan, state, self._config)
            mode = Mode.WAITING if self.goal is None else Mode.REACHED
            self._navigator = None
            return Action(mode, *self._slowed(), bad_scan=bad)
        if self._navigator is None:
            # The map has the free space around its start already.
            config = replace(self._config, start_margin=0.0)
            self._navigator = Navigator(
                config, self._predictor, state, self.goal, self.known, executor=self._executor
            )
        decision = self._navigator.step(state, scan)
        car = self._config.car
        resort = self._navigator.chooser.resort.controls
        self._stop = stop_after(decision.plan, resort, car.braking)
        twist = twist_of(decision.control, float(state[3]), car)
        self._speed = twist.speed
        return Action(Mode.DRIVING, twist.speed, twist.yaw_rate, decision)

    def stop(self) -> Action:
        """Return what to do in a tick without a scan or a pose: stop, and then stand."""
        self._navigator = None
        return Action(Mode.STOPPED, *self._slowed())

    def _slowed(self) -> tuple[float, float]:
        """Return the speed [m/s] and the yaw rate [rad/s] of the next tick of the stop."""
        if not self._stop:
            self._speed = 0.0
            return 0.0, 0.0
        twist = twist_of(self._stop.pop(0), self._speed, self._config.car)
        self._speed = twist.speed
        if self._speed == 0.0:
            self._stop = []
        return twist.speed, twist.yaw_rate
