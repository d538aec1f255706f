"""The simulated robot: a building, a car that obeys velocities, and its LIDAR."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.control import Control
from foresee.mapping.conventions import GOAL_RADIUS
from foresee.mapping.scan import Scan
from foresee_navigator.settings import SimulatorSettings
from sim import DubinsCar, Lidar, Task, sample_task
from sim.buildings import building

STEP = 0.02
"""Length of a step of the motion [s]."""
LONGEST_WAY = 4.0
"""Longest way to the goal, as a multiple of the shortest that was asked for."""


def task_for(settings: SimulatorSettings) -> Task:
    """Return the building, the start and the goal that settings describe.

    Raises:
        MapError: if the file of the map cannot be read.
        NoTaskError: if the building has no way of that length.
    """
    world = building(settings.world, settings.seed)
    longest = LONGEST_WAY * settings.length
    return sample_task(world, settings.seed, settings.car, settings.length, longest)


class SimulatedRobot:
    """A car that follows velocities within its limits, like the controller of a mobile base.

    It turns on the curvature of the command while its speed approaches the commanded one. If it
    can, it turns on the spot where it stands and no speed is commanded.

    Args:
        settings: settings of the simulator.
        task: building, start and goal.

    Attributes:
        time: simulated time [s].
        state: x, y, yaw, v, (4,) [m, m, rad, m/s].
        yaw_rate: turning rate [rad/s].
        has_collided: whether the car has met a wall, where it stays.
        has_reached: whether it has been within `GOAL_RADIUS` of the goal.
    """

    def __init__(self, settings: SimulatorSettings, task: Task) -> None:
        self.time, self.has_collided, self.has_reached = 0.0, False, False
        self.state = np.array([*task.start, 0.0])
        self._settings, self._task = settings, task
        self._car, self._lidar = DubinsCar(settings.car), Lidar(settings.lidar)
        self._rng = np.random.default_rng([settings.seed, 3])
        self._speed = self._curvature = self._turn_rate = 0.0
        self._commanded = -math.inf
        self.yaw_rate = 0.0

    @property
    def to_goal(self) -> float:
        """Distance to the goal [m]."""
        return math.dist(self.state[:2], self._task.goal)

    @property
    def is_commanded(self) -> bool:
        """Whether a command came within the last `command_timeout`."""
        return self.time - self._commanded <= self._settings.command_timeout

    def command(self, speed: float, yaw_rate: float) -> None:
        """Take a velocity: speed [m/s], negative in reverse, and yaw rate [rad/s].

        Raises:
            ValueError: if a value is not finite.
        """
        if not math.isfinite(speed + yaw_rate):
            raise ValueError(f"command is {speed} m/s, {yaw_rate} rad/s, it must be finite")
        car = self._settings.car
        self._speed = min(max(speed, -car.reverse), car.v_max)
        self._curvature = yaw_rate / speed if abs(speed) > 1e-3 else 0.0
        self._turn_rate = yaw_rate if speed == 0.0 and car.turn_rate else 0.0
        self._commanded = self.time

    def step(self) -> None:
        """Move by one step."""
        if self.has_collided:
            self.time += STEP
            return
        if not self.is_commanded:
            self._speed = self._turn_rate = 0.0
        speed, wanted = float(self.state[3]), self._speed
        if speed * wanted < 0.0:
            wanted = 0.0  # The gear changes at standstill.
        gear = 1 if speed > 0.0 or (speed == 0.0 and wanted >= 0.0) else -1
        acceleration = (abs(wanted) - abs(speed)) / STEP
        control = Control(acceleration, self._curvature, gear, self._turn_rate)
        if self._car.collides(self._task.world, self.state, control, STEP):
            self.has_collided = True
            self.state[3] = self.yaw_rate = 0.0
        else:
            after = self._car.step(self.state, control, STEP)
            turned = math.remainder(after[2] - self.state[2], 2.0 * math.pi)
            self.state, self.yaw_rate = after, turned / STEP
        self.has_reached |= self.to_goal <= GOAL_RADIUS
        self.time += STEP

    def scan(self) -> Scan:
        """Take a scan."""
        return self._lidar.scan(self._task.world, self.state, self._rng)


def due(time: float, period: float) -> bool:
    """Return whether something that is done once a period is due at a step of the time [s]."""
    return round(time / STEP) % max(1, round(period / STEP)) == 0


def fields_of(scan: Scan) -> dict[str, float | NDArray[np.float64]]:
    """Return the fields of the sensor_msgs/LaserScan of a scan, by name, without its ranges."""
    return {
        "angle_min": scan.angle_min,
        "angle_max": scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment,
        "angle_increment": scan.angle_increment,
        "range_min": 0.02,
        "range_max": scan.range_max,
    }
