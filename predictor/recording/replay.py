"""A drive without prediction, and its replay with other LIDARs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.grid import OccupancyGrid
from planner.navigator import Navigator, NavigatorConfig
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import EpisodeConfig, run_episode
from sim.task import Task


def drive_without_prediction(
    task: Task,
    window: float,
    reliance: float,
    rng: np.random.Generator,
    longest: float | None = None,
) -> NDArray[np.float64]:
    """Drive without prediction, and return the states (T, 4).

    Args:
        task: building, start and goal.
        window: side of the square in which the LIDAR is used [m].
        reliance: 0: unobserved cells count as occupied; 1: they count as free.
        rng: generator of the LIDAR's noise.
        longest: time after which the drive is stopped [s]; None: never.
    """
    config = NavigatorConfig(window=window, reliance=reliance)
    start, car, ending = np.array(task.start), DubinsCar(), EpisodeConfig()
    if longest is not None:
        ending = EpisodeConfig(timeout=longest * car.limits.v_max / task.path_length)
    navigator = Navigator(config, None, start, task.goal, task.blank(window), seed=task.seed)
    episode = run_episode(task, navigator, car, Lidar(), ending, rng)
    states: NDArray[np.float64] = episode.trace["states"][:-1]
    return states


def replayed_with(
    task: Task,
    states: NDArray[np.float64],
    window: float,
    lidar: LidarConfig,
    rng: np.random.Generator,
    every: int,
    first: int = 0,
) -> Iterator[tuple[OccupancyGrid, NDArray[np.float64]]]:
    """Replay a drive with another LIDAR, and yield the observed map and the state every few ticks.

    The map is the same object each time, and changes; copy what must not change.

    Args:
        task: building and start.
        states: states of the drive, (T, 4).
        window: side of the square in which the LIDAR is used [m].
        lidar: settings of the LIDAR.
        rng: generator of the LIDAR's noise.
        every: number of ticks from one yielded map to the next.
        first: number of the first tick whose map is yielded, below `every`.
    """
    known, sensor = task.blank(window), Lidar(lidar)
    known.mark_free(task.start, Body(), NavigatorConfig().start_margin)
    for tick, state in enumerate(states):
        known.integrate(sensor.scan(task.world, state, rng), state)
        if tick % every == first:
            yield known, state
