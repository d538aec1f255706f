"""The pilot: keeps one map over all goals, and says in each tick how fast to drive."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.commands import TwistCommand, twist_of
from foresee.mapping.control import Control
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan
from foresee_navigator.mapping import new_map, observe
from planner.decision import Decision
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.risk.predictor_process import PredictorProcess

SAME_GOAL = 0.01
"""Distance below which two goals are the same [m]."""
STANDS = 0.05
"""Speed below which a car counts as standing, whose speed is measured with noise [m/s]."""

RESTS = 0.01
"""Speed up to which the navigator is told that the car stands [m/s]: it changes the gear and turns
on the spot only at a speed of 0, which a noisy measurement would never show."""
STILL = TwistCommand(0.0, 0.0)
"""Command to stand."""


class Mode(StrEnum):
    """What the pilot does."""

    WAITING = "waits for a goal"
    DRIVING = "drives"
    LATE = "goes on with what it has kept, since the decision is late"
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
        refused: why the goal was given up; empty if it was not.
    """

    mode: Mode
    speed: float
    yaw_rate: float
    decision: Decision | None = None
    bad_scan: bool = False
    refused: str = ""


class Pilot:
    """Drives to one goal after the other, with one map.

    The navigator stays from goal to goal, and is told of each tick without a decision: what it
    promises holds only if it knows all that was sent. It is replaced only while the car stands.

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
        self._last: Decision | None = None
        self._has_reached = self._decides = False
        self._sent = STILL

    def head_for(self, goal: tuple[float, float]) -> bool:
        """Take a goal x, y [m], and return whether it is a new one.

        Raises:
            ValueError: if it is not finite, or so far away that the map would need more than 10⁹
                cells; the goal before it stays.
        """
        if not all(map(math.isfinite, goal)):
            raise ValueError(f"goal is {goal}, it must be finite")
        if self.goal is not None and math.dist(goal, self.goal) < SAME_GOAL:
            return False
        if self._navigator is not None:
            self._navigator.head_for(goal)
        self.goal, self._has_reached = goal, False
        return True

    def forget(self) -> None:
        """Begin a new map, since the old one does not fit the poses any more.

        A goal that was not reached stays. The car brakes until it stands.
        """
        self.known = self._navigator = self._last = None
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
        if abs(float(state[3])) <= RESTS:
            state = np.array([*state[:3], 0.0])
        rolls = self._navigator is None and abs(float(state[3])) > STANDS
        if self.known is None and not rolls:
            self.known = new_map(self._config, self._resolution, state)
        if self.goal is not None and math.dist(state[:2], self.goal) <= self._goal_radius:
            self._has_reached = True
        self._decides = False
        if rolls and self._sent.speed == 0.0:
            self._sent = TwistCommand(float(state[3]), 0.0)
        if self.known is None or self.goal is None or self._has_reached or rolls:
            # A new map begins where the car stands: what is free around it is known only there.
            bad = self.known is not None and not observe(self.known, scan, state, self._config)
            mode = Mode.REACHED if self._has_reached else Mode.WAITING
            twist = self._slowed()
            return self._action(Mode.STOPPED if rolls else mode, twist, bad_scan=bad)
        navigator = self._navigator
        if navigator is None:
            # The map has the free space around its start already.
            config = replace(self._config, start_margin=0.0)
            try:
                navigator = Navigator(
                    config, self._predictor, state, self.goal, self.known, executor=self._executor
                )
            except ValueError as error:
                # It is too far away for a map.
                self.goal = None
                return self._action(Mode.WAITING, self._slowed(), refused=str(error))
        self._last = navigator.step(state, scan)
        self._navigator, self._decides = navigator, True
        return self._action(Mode.DRIVING, self._twist_of(self._last), self._last)

    def coming(self, speed: float) -> list[TwistCommand]:
        """Return the commands of the coming ticks if no decision follows; they stop the car.

        There are none for a car that stands: for it a late decision is as good.

        Args:
            speed: speed of the car [m/s].
        """
        last, commands = self._last, list[TwistCommand]()
        if last is None or (self._sent == STILL and abs(speed) <= STANDS):
            return commands
        then = self._twist_of(last).speed
        for acceleration, curvature in last.last_resort[1:].tolist():
            control = Control(acceleration, curvature, last.control.gear)
            commands.append(twist_of(control, then, self._config.car))
            then = commands[-1].speed
        return commands

    def late(self, ticks: int) -> Action:
        """Return what was done in ticks in which `act` was not ready in time.

        The commands of `coming` were sent in its place. If it made a decision, that is withdrawn.

        Args:
            ticks: number of these commands.
        """
        if self._navigator is not None:
            if self._decides:
                self._navigator.withdraw()
            else:
                # `act` has skipped the first of these ticks already.
                ticks -= 1
            for _ in range(ticks):
                self._sent = self._slowed()
        return self._action(Mode.LATE, self._sent)

    def stop(self) -> Action:
        """Return what to do in a tick without a scan or a pose: stop, and then stand."""
        return self._action(Mode.STOPPED, self._slowed())

    def _action(
        self, mode: Mode, twist: TwistCommand, decision: Decision | None = None, **more: Any
    ) -> Action:
        self._sent = twist
        return Action(mode, twist.speed, twist.yaw_rate, decision, **more)

    def _slowed(self) -> TwistCommand:
        """Return the command of the next tick of the stop."""
        car, sent = self._config.car, self._sent
        if self._navigator is None:
            # Nothing is known of the surroundings.
            curvature = sent.yaw_rate / sent.speed if sent.speed else 0.0
            return twist_of(Control(-car.braking, curvature), sent.speed, car)
        self._last = self._navigator.skip()
        return self._twist_of(self._last)

    def _twist_of(self, decision: Decision) -> TwistCommand:
        """Return the command of a decision, from the speed that the car has when it acts."""
        return twist_of(decision.control, decision.speed, self._config.car)
