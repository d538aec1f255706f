"""The simulated car as an environment of Gymnasium (`pip install 'foresee-nav[gym]'`).

    import foresee.gym, gymnasium
    env = gymnasium.make("foresee/Corridor-v1")

`as_driver` makes a driver of the race from what an agent has learned in it. No other module of this
package imports gymnasium.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.conventions import RESOLUTION, REST
from foresee.mapping.grid import Grid, OccupancyGrid
from foresee.mapping.polyline import arc_length, points_at
from foresee.mapping.scan import Scan
from sim.buildings import task_in_world
from sim.car import DubinsCar
from sim.controller import Controller, Mission
from sim.episode import EpisodeConfig, Outcome, outcome_of
from sim.families import generate
from sim.lidar import Lidar
from sim.sight import Sight
from sim.suite import Suite
from sim.task import NoTaskError, Task

COLLISION = 20.0
"""What a collision takes from the reward [m of progress]."""
EVERY = 10
"""The observation has every so many beams of the LIDAR."""
AHEAD = 3.0
"""Distance along the prescribed route of the point that is shown [m]."""
BACK, FORTH, STEP = 2.0, 4.0, 0.1
"""How far along the way, backwards and forwards, the car's place on it is looked for in a tick;
distance of the points that are tried [m]."""
FARTHEST = 1000.0
"""Bound of the coordinates in an observation [m]."""
FIRST_SEED, SEEDS = 200_000_000, 500_000_000
"""First seed of the buildings to learn in, and number of them. The suites, and all published
drives, use others."""
OBSERVATIONS = ("scan", "map")

Observation = dict[str, NDArray[Any]]


class Interface:
    """Turns what a controller gets into an observation, and an action into a control.

    Args:
        mission: what a controller is told of the drive.
        observe: "scan" or "map".
    """

    def __init__(self, mission: Mission, observe: str) -> None:
        self.mission, self.observe = mission, observe
        waypoints = mission.waypoints
        self._route = None if waypoints is None else Along(mission.start, waypoints)

    def observation(
        self, state: NDArray[np.float64], scan: Scan, known: Grid | OccupancyGrid
    ) -> Observation:
        """Return what an agent observes, see `DriveEnv`; the arguments are those of a controller.

        To be called once in each tick, since the place on the route is followed.
        """
        x, y, yaw, speed = state
        cos, sin = math.cos(yaw), math.sin(yaw)
        goal = np.array(self.mission.goal)
        point = goal
        if self._route is not None:
            self._route.move(state)
            point = self._route.ahead(AHEAD)
        ends = (np.array([goal, point]) - (x, y)) @ np.array([[cos, -sin], [sin, cos]])
        motion = np.array([speed, cos, sin, *ends.ravel()], dtype=np.float32)
        if self.observe == "scan":
            return {"motion": motion, "scan": _ranges(scan)}
        near = known.crop(known.frame.square(x, y, self.mission.window))
        return {"motion": motion, "map": _image(near)}

    def control(self, action: NDArray[np.float32], speed: float) -> Control:
        """Return the control that an action stands for, see `DriveEnv`, at a speed [m/s]."""
        limits = self.mission.car
        drive, steer = (float(value) for value in np.clip(action, -1.0, 1.0))
        backwards = speed < -REST or (limits.reverse > 0 and speed < REST and drive < 0)
        along = -drive if backwards else drive
        acceleration = along * (limits.acceleration if along > 0 else limits.braking)
        return Control(acceleration, steer * limits.max_curvature, -1 if backwards else 1)


class Along:
    """A place that moves along a way.

    Args:
        start: x, y, ... of the start of the way [m].
        points: its further points, (n, 2) [m].
    """

    def __init__(self, start: tuple[float, ...], points: NDArray[np.float64]) -> None:
        way = np.vstack([start[:2], points])
        length = arc_length(way)[-1]
        self.along = np.arange(0.0, length + STEP, STEP).clip(max=length)
        self.points = points_at(way, self.along)
        self.index = 0

    def move(self, state: NDArray[np.float64]) -> float:
        """Move the place to the point near it that is nearest to the car.

        Returns:
            How far it moved [m]; less than 0: backwards.
        """
        first, before = max(0, self.index - round(BACK / STEP)), self.along[self.index]
        near = self.points[first : self.index + round(FORTH / STEP) + 1]
        self.index = first + int(np.hypot(*(near - state[:2]).T).argmin())
        return float(self.along[self.index] - before)

    def ahead(self, distance: float) -> NDArray[np.float64]:
        """Return the point a distance [m] further along the way, (2,) [m]; at most its end."""
        point: NDArray[np.float64] = self.points[
            min(self.index + round(distance / STEP), len(self.points) - 1)
        ]
        return point


def as_driver(act: Callable[[Observation], Any], observe: str = "scan") -> type[Controller]:
    """Return a driver of the race that acts as an agent does in `DriveEnv`.

    Args:
        act: function from an observation to an action, such as the prediction of a learned policy.
        observe: what the agent observes, "scan" or "map".
    """

    class Agent:
        def __init__(self, mission: Mission) -> None:
            self._interface = Interface(mission, observe)

        def control(self, state: NDArray[np.float64], scan: Scan, known: Grid) -> Control:
            """Return the control that the agent's action stands for."""
            action = act(self._interface.observation(state, scan, known))
            return self._interface.control(np.asarray(action), float(state[3]))

    return Agent


class DriveEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A drive through a building that is unknown to the car, in ticks of 0.1 s.

    **Action**: two numbers in [−1, 1]. The first drives: 1 is the largest acceleration, and −1 the
    hardest braking; a car with a reverse gear that stands then drives backwards. The second steers:
    1 is the tightest left turn. Like any driver's, a control beyond what the tyres hold is reduced.

    **Observation**: a dictionary.

    - `motion`, (7,) float32: speed [m/s]; cosine and sine of the yaw; x, y of the goal in the car's
      frame [m]; x, y of the point 3 m ahead on the prescribed route in the car's frame [m], of the
      goal on a free route.
    - `scan`, (109,) float32: ranges of every tenth beam from right to left, at most the reach of
      the window [m]; 0 where a beam has no measurement. With `observe="scan"`.
    - `map`, (1, n, n) uint8: what was observed of the window around the car, rows along y and
      columns along x: 0 free, 255 occupied, 127 unknown. With `observe="map"`.

    **Reward**: metres of progress in the tick along a way to the goal on the true map, less
    `COLLISION` for a collision. With a discount, faster is better.

    **End**: terminated when the goal is reached or the car collides; truncated when it is stuck, or
    after eight times the time that the way takes at top speed. `info["outcome"]` tells which, as
    `sim.episode.Outcome`; "" before.

    Args:
        suite: suite whose car, window, route and kinds of buildings the drives have.
        observe: "scan" or "map".
        evaluate: drive in the buildings of the suite, in their order, instead of in others of
            the same families. A learner must not learn in them.
        buildings: number of buildings to learn in; None: each `reset` draws a new one. They are
            kept in memory, a few MB each, because to draw one takes as long as hundreds of ticks.

    Raises:
        SuiteError: if there is no such suite.
        ValueError: if `observe` is neither, or `buildings` is less than 1.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  As gymnasium declares it.

    def __init__(
        self,
        suite: str,
        observe: str = "scan",
        evaluate: bool = False,
        buildings: int | None = None,
    ) -> None:
        if observe not in OBSERVATIONS:
            raise ValueError(f"observe is {observe!r}, it must be of {', '.join(OBSERVATIONS)}")
        if buildings is not None and buildings < 1:
            raise ValueError(f"buildings is {buildings}, it must be at least 1")
        self.suite, self.observe, self.evaluate = Suite.read(suite), observe, evaluate
        self._families = tuple(dict.fromkeys(place.family for place in self.suite.places))
        self._car, self._lidar = DubinsCar(self.suite.car), Lidar()
        self._config = EpisodeConfig()
        self._next = 0
        self._buildings = buildings
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        spaces = {"motion": Box(-FARTHEST, FARTHEST, (7,), np.float32)}
        if observe == "scan":
            beams = len(range(0, self._lidar.config.beams, EVERY))
            spaces["scan"] = Box(0.0, 0.5 * self.suite.window, (beams,), np.float32)
        else:
            cells = round(self.suite.window / RESOLUTION)
            spaces["map"] = Box(0, 255, (1, cells, cells), np.uint8)
        self.observation_space = Dict(spaces)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a drive in another building.

        Args:
            seed: seed of the buildings from here on; with `evaluate`, begin with the first one.
            options: `building`, the number of a building of the suite, to drive in that one.

        Raises:
            SuiteError: if this version draws another building than the suite has.
            NoTaskError: if none of the `buildings` to learn in has a route.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._next = 0
        self._task = self._draw((options or {}).get("building"))
        self._states = [np.array([*self._task.start, 0.0])]
        self._left = self._config.ticks(self._task, self.suite.v_max)
        self._sight = Sight(self._task, self.suite.car.body, self.suite.window)
        self._way = Along(self._task.start, self._task.waypoints)
        prescribed = self.suite.route == "fixed"
        mission = Mission.of(self._task, self.suite.car, self.suite.window, prescribed)
        self._interface = Interface(mission, self.observe)
        return self._observe(), self._info(None)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for a tick; see the class."""
        state = self._states[-1]
        control = self._interface.control(action, float(state[3]))
        collided = self._car.collides(self._task.world, state, control, self._config.dt)
        self._states.append(self._car.step(state, control, self._config.dt))
        self._left -= 1
        outcome = outcome_of(self._states, collided, self._task.goal, self._config)
        if outcome is None and self._left <= 0:
            outcome = Outcome.TIMED_OUT
        terminated = outcome in (Outcome.REACHED, Outcome.COLLIDED)
        reward = self._way.move(self._states[-1]) - COLLISION * collided
        truncated = outcome is not None and not terminated
        return self._observe(), reward, terminated, truncated, self._info(outcome)

    def _draw(self, building: int | None) -> Task:
        """Return a task in the building asked for, else in the next one."""
        if building is None and self.evaluate:
            building = self._next
            self._next = (self._next + 1) % len(self.suite.places)
        if building is not None:
            return self.suite.task(building)
        rules = self.suite.car, self.suite.route == "fixed"
        task: Task | None = None
        barred = set[int]()
        while task is None:
            if self._buildings is None:
                family = self._families[self.np_random.integers(len(self._families))]
                task = _task_in(family, int(self.np_random.integers(SEEDS)), *rules)
            else:
                number = int(self.np_random.integers(self._buildings))
                task = _kept_task_in(self._families[number % len(self._families)], number, *rules)
                if task is None:
                    barred.add(number)
                if len(barred) == self._buildings:
                    raise NoTaskError("no building to learn in has a route: ask for more")
        return task

    def _observe(self) -> Observation:
        """Take a scan, and return what the agent observes."""
        state = self._states[-1]
        scan = self._sight.add(self._lidar.scan(self._task.world, state), state)
        return self._interface.observation(state, scan, self._sight.known)

    def _info(self, outcome: Outcome | None) -> dict[str, Any]:
        return {
            "outcome": "" if outcome is None else str(outcome),
            "building": self._task.world.name,
            "time": (len(self._states) - 1) * self._config.dt,
        }


def _task_in(family: str, number: int, car: CarLimits, prescribed: bool) -> Task | None:
    """Return the task in a building to learn in, or None if it has none.

    Args:
        family: family of the building.
        number: number of its seed, from 0.
        car: limits of the car.
        prescribed: whether the route is prescribed, and must not come back.
    """
    seed = FIRST_SEED + number
    try:
        task = task_in_world(generate(family, seed), seed, car)
    except NoTaskError:
        return None
    return None if prescribed and task.comes_back else task


_kept_task_in = cache(_task_in)
"""The same, kept in memory for all environments of the process."""


def _ranges(scan: Scan) -> NDArray[np.float32]:
    """Return every tenth range of a scan, at most its reach, and 0 without a measurement [m]."""
    ranges = np.minimum(scan.ranges[::EVERY], scan.range_max)
    return np.nan_to_num(ranges, nan=0.0).astype(np.float32)


def _image(known: Grid) -> NDArray[np.uint8]:
    """Return an observed map as an image, (1, rows, columns)."""
    image = np.full(known.frame.shape, 127, dtype=np.uint8)
    image[known.free], image[known.occupied] = 0, 255
    return image[None]
