"""Controllers: drivers of one method, which get what the car has observed and return a control.

`ControllerDriver` seats a controller in the closed loop of `sim.episode`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import Grid, OccupancyGrid
from foresee.mapping.scan import Scan
from sim.sight import Sight
from sim.task import Task


class ControllerError(LineError):
    """A controller raised an error or returned no proper control; the message is one line."""


@dataclass(frozen=True, eq=False)
class Mission:
    """What a controller is told before a drive.

    Attributes:
        start: x, y, yaw at the start [m, m, rad].
        goal: x, y of the goal [m].
        goal_radius: distance from the goal within which it is reached, at any speed [m].
        waypoints: points about 2 m apart along the prescribed route, the goal the last, (n, 2)
            [m]; None: the route is free.
        car: the car's limits and its body.
        window: side of the square around the car in which the LIDAR is used [m].
        seed: seed for random numbers, so that the same drive can be repeated.
    """

    start: tuple[float, float, float]
    goal: tuple[float, float]
    goal_radius: float
    waypoints: NDArray[np.float64] | None
    car: CarLimits
    window: float
    seed: int

    @classmethod
    def of(cls, task: Task, car: CarLimits, window: float, prescribed: bool) -> Self:
        """Return what a controller is told of a task.

        Args:
            task: task to drive.
            car: the car's limits and its body.
            window: side of the square around the car in which the LIDAR is used [m].
            prescribed: whether the controller is told the route.
        """
        waypoints = task.waypoints.copy() if prescribed else None
        radius = task.rules.goal_radius
        return cls(task.start, task.goal, radius, waypoints, car, window, task.seed)


class Controller(Protocol):
    """Decides on the car's control, tick after tick."""

    def control(self, state: NDArray[np.float64], scan: Scan, known: Grid) -> Control:
        """Return the control of the next tick of 0.1 s.

        Args:
            state: x, y, yaw, v of the car, (4,) [m, m, rad, m/s].
            scan: LIDAR scan taken at that state. It ends where the window does: a range of +inf
                means that there is no obstacle within `scan.range_max`.
            known: map of all that was observed in the window so far.
        """
        ...


class OneTick(NamedTuple):
    """The plan of a controller: the control that it chose, for one tick."""

    states: NDArray[np.float64]
    controls: NDArray[np.float64]
    gear: int


@dataclass(frozen=True, eq=False)
class ControllerDecision:
    """A control of a controller, as the closed loop records it; see `sim.driver_protocol`."""

    control: Control
    plan: OneTick
    times: Mapping[str, float]
    last_resort: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    limit: str = "controller"
    faults: Sequence[str] = ()
    relied: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    emergency: bool = False


class ControllerDriver:
    """A driver of `sim.episode.run_episode` that asks a controller.

    It keeps the map, and shortens the scans: the controller sees what the planner of this project
    sees in the same window.

    Args:
        make: class of the controller, or any function that makes one from a `Mission`.
        task: task to drive.
        car: the car's limits and its body.
        window: side of the square around the car in which the LIDAR is used [m].
        prescribed: whether the controller is told the route.

    Raises:
        ControllerError: if the controller cannot be made.
    """

    def __init__(
        self,
        make: Callable[[Mission], Controller],
        task: Task,
        car: CarLimits,
        window: float,
        prescribed: bool,
    ) -> None:
        self._sight = Sight(task, car.body, window)
        self.path_counts = dict[str, int]()
        self._car, self._last = car, Control(0.0, 0.0)
        self._name = getattr(make, "__qualname__", repr(make))
        try:
            self._controller = make(Mission.of(task, car, window, prescribed))
        except (Exception, SystemExit) as error:
            raise ControllerError(f"{self._name} could not be made: {one_line(error)}") from error

    @property
    def known(self) -> OccupancyGrid:
        """Map of all that has been observed so far."""
        return self._sight.known

    def step(self, state: NDArray[np.float64], scan: Scan) -> ControllerDecision:
        """Add the scan to the map, and ask the controller.

        Raises:
            ControllerError: if the controller raises an error, or returns no proper control.
        """
        started = time.perf_counter()
        seen = self._sight.add(scan, state)
        try:
            control = self._controller.control(state.copy(), seen, self.known.whole())
        except (Exception, SystemExit) as error:
            raise ControllerError(f"{self._name}.control: {one_line(error)}") from error
        self._check(control)
        self._last = control
        return self._decision(state, control, 1e3 * (time.perf_counter() - started))

    def skip(self) -> ControllerDecision:
        """Brake, on the arc of the last control."""
        braking = replace(self._last, acceleration=-self._car.braking, turn_rate=0.0)
        return self._decision(np.zeros(4), braking, 0.0)

    def _decision(
        self, state: NDArray[np.float64], control: Control, cycle: float
    ) -> ControllerDecision:
        chosen = np.array([[control.acceleration, control.curvature]])
        plan = OneTick(np.array([state, state]), chosen, control.gear)
        return ControllerDecision(control, plan, {"cycle": cycle})

    def _check(self, control: object) -> None:
        what = f"{self._name}.control returned {control!r}"
        if not isinstance(control, Control):
            raise ControllerError(f"{what}, it must return a foresee.mapping.control.Control")
        values = (control.acceleration, control.curvature, control.turn_rate)
        if not all(isinstance(value, Real) and math.isfinite(value) for value in values):
            raise ControllerError(f"{what}, whose values must be finite numbers")
        gears = (1, -1) if self._car.reverse else (1,)
        if not isinstance(control.gear, Real) or control.gear not in gears:
            which = "1 or -1" if self._car.reverse else "1: this car has no reverse gear"
            raise ControllerError(f"{what}, whose gear must be {which}")
        if control.turn_rate and self._car.turn_rate == 0:
            raise ControllerError(f"{what}: this car cannot turn on the spot")
