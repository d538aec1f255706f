"""Maps of given sizes for timing, and poses in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from predictor.recording.rescan import rescanned
from sim import LidarConfig
from sim.task import Task
from sim.world import World

PER_TICK = 0.25
"""Distance from one pose of `on_ways` to the next [m]: one tick at 2.5 m/s."""
TICKS = 20
"""Largest number of poses on one straight line of `on_ways`."""
CLEAR = 0.3
"""Smallest clearance of a pose of `on_ways` [m], above `PER_TICK`: lines do not cross walls."""


def along(task: Task, count: int) -> NDArray[np.float64]:
    """Return poses along a task's route, (count, 3)."""
    route = task.waypoints
    at = np.linspace(1, len(route) - 2, count).astype(int)
    ahead = route[at + 1] - route[at]
    return np.column_stack([route[at], np.arctan2(ahead[:, 1], ahead[:, 0])])


def crops_along(task: Task, count: int) -> list[Grid]:
    """Return the observed map of the 10 m square around each pose of a drive along a route."""
    states = np.column_stack([along(task, count), np.zeros(count)])
    seen = rescanned(task, states, 5.0, LidarConfig(), np.random.default_rng(0), 1)
    return [known.crop(known.frame.square(s[0], s[1], 10.0)) for known, s in seen]


def anywhere(world: World, count: int) -> NDArray[np.float64]:
    """Return random poses in free cells of a map, uniformly distributed, (count, 3)."""
    rng, frame = np.random.default_rng(0), world.grid.frame
    free = np.argwhere(world.grid.free)
    rows, cols = free[rng.integers(len(free), size=count)].T
    xs, ys = frame.centres()
    return np.column_stack([xs[cols], ys[rows], rng.uniform(-np.pi, np.pi, count)])


def on_ways(world: World, count: int) -> NDArray[np.float64]:
    """Return poses `PER_TICK` apart on straight lines, as of a driving car, (at most `count`, 3).

    The lines begin at random places, and end near walls.
    """
    poses: list[tuple[float, float, float]] = []
    for x, y, yaw in anywhere(world, count):
        for _ in range(TICKS):
            if world.clearance[world.grid.frame.cell(x, y)] < CLEAR:
                break
            poses.append((x, y, yaw))
            x, y = x + PER_TICK * np.cos(yaw), y + PER_TICK * np.sin(yaw)
    return np.array(poses[:count])


def corridors(task: Task, side: int) -> World:
    """Return a square part of a building, around the middle of a task's route.

    Args:
        task: building and route.
        side: side of the square [cells].
    """
    grid = task.world.grid
    middle = 0.5 * (task.waypoints.min(axis=0) + task.waypoints.max(axis=0))
    frame = grid.frame.square(float(middle[0]), float(middle[1]), side * grid.frame.resolution)
    return World(f"{task.world.name}-{side}", grid.crop(frame))


def cluttered(side: int, seed: int) -> World:
    """Return a square hall with one box per 6 m² of floor.

    Args:
        side: side of the hall, in cells.
        seed: seed of the boxes.
    """
    rng = np.random.default_rng(seed)
    cells = np.full((side, side), FREE, dtype=np.int8)
    for _ in range(round((RESOLUTION * side) ** 2 / 6)):
        row, col = rng.integers(side, size=2)
        high, wide = rng.integers(3, 25, size=2)
        cells[row : row + high, col : col + wide] = OCCUPIED
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return World(f"hall-{side}", Grid(GridFrame(RESOLUTION, (0.0, 0.0), (side, side)), cells))
