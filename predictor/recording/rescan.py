"""A drive or walk, scanned again with another LIDAR."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.grid import OccupancyGrid
from sim import Lidar, LidarConfig
from sim.task import Task


def rescanned(
    task: Task,
    states: NDArray[np.float64],
    window: float,
    lidar: LidarConfig,
    rng: np.random.Generator,
    every: int,
    first: int = 0,
) -> Iterator[tuple[OccupancyGrid, NDArray[np.float64]]]:
    """Scan again along a drive or walk with another LIDAR; yield observed maps and states.

    The map is the same object each time, and changes; copy what must not change.

    Args:
        task: building and start.
        states: states or poses, (T, 3) or more.
        window: side of the square in which the LIDAR is used [m].
        lidar: settings of the LIDAR.
        rng: generator of the LIDAR's noise.
        every: number of ticks from one yielded map to the next.
        first: number of the first tick whose map is yielded, below `every`.
    """
    known, sensor = task.blank(window), Lidar(lidar)
    task.mark_start(known, Body())
    for tick, state in enumerate(states):
        known.integrate(sensor.scan(task.world, state, rng), state)
        if tick % every == first:
            yield known, state
