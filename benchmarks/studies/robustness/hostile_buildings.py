"""Buildings and starts that are hard to drive in: other cells, thin walls, pockets, the lattice."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body, Scene, first_contact
from foresee.mapping.car_limits import CONTACT_MARGIN, CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from sim.task import NoTaskError, Task, sample_task
from sim.world import World

MOST_CELLS = 1200
"""Largest number of rows and columns of a building with cells below 0.05 m: 12 m at 0.01 m. Maps of
whole buildings would take gigabytes and minutes."""
LENGTHS = (20.0, 10.0, 5.0)
"""Least lengths of a task's route that are tried in turn [m]."""
LEAST_TURN = 0.5
"""Least turning radius for which the route of a task is searched [m]; tighter cars can drive it."""
FREE_PER_WALL = 15.0
"""Free space for each thin wall [m²]."""
LONGEST_WALL = 2.0
"""Longest thin wall [m]."""
NARROWEST, WIDEST = 0.04, 0.4
"""Least and largest gap between the body and the walls of a pocket [m]."""
TRIES = 100


def resampled(world: World, resolution: float, rng: np.random.Generator) -> World:
    """Return a building with cells of another size, each of the kind at its centre.

    If these would be too many, a square around a random free place is cut out.

    Args:
        world: building.
        resolution: side of the new cells [m].
        rng: source of the place.
    """
    old = world.grid.frame
    shape = [math.ceil(count * old.resolution / resolution) for count in old.shape]
    first = np.zeros(2, dtype=int)
    if resolution < old.resolution:
        free = np.argwhere(world.grid.free)
        middle = (free[rng.integers(len(free))] + 0.5) * old.resolution / resolution
        spare = np.maximum(np.array(shape) - MOST_CELLS, 0)
        first = np.clip(middle.astype(int) - MOST_CELLS // 2, 0, spare)
    rows, cols = (
        np.minimum(
            (
                (start + np.arange(min(count, MOST_CELLS)) + 0.5) * resolution / old.resolution
            ).astype(int),
            had - 1,
        )
        for start, count, had in zip(first, shape, old.shape, strict=True)
    )
    origin = (
        old.origin[0] + float(first[1]) * resolution,
        old.origin[1] + float(first[0]) * resolution,
    )
    frame = GridFrame(resolution, origin, (len(rows), len(cols)))
    return World(world.name, Grid(frame, world.grid.cells[np.ix_(rows, cols)]))


def with_thin_walls(world: World, rng: np.random.Generator) -> World:
    """Return a building with more walls, one cell thick, along the axes and the diagonals."""
    frame, cells = world.grid.frame, world.grid.cells.copy()
    free = np.argwhere(world.grid.free)
    for _ in range(int(len(free) * frame.resolution**2 / FREE_PER_WALL)):
        step = np.array([(0, 1), (1, 0), (1, 1), (1, -1)])[rng.integers(4)]
        count = math.ceil(rng.uniform(0.0, LONGEST_WALL) / frame.resolution)
        wall = free[rng.integers(len(free))] + np.arange(count)[:, None] * step
        wall = wall[((wall >= 0) & (wall < cells.shape)).all(axis=1)]
        wall = wall[cells[tuple(wall.T)] == FREE]
        cells[tuple(wall.T)] = OCCUPIED
    return World(world.name, Grid(frame, cells))


def task_for(world: World, seed: int, car: CarLimits) -> Task:
    """Return a task for a car, of 20 m or more, or shorter if there is none.

    Raises:
        NoTaskError: if there is no route of 5 m.
    """
    car = replace(car, turning_radius=max(car.turning_radius, LEAST_TURN))
    for least in LENGTHS[:-1]:
        try:
            return sample_task(world, seed, car, least)
        except NoTaskError:
            continue
    return sample_task(world, seed, car, LENGTHS[-1])


def in_pocket(task: Task, body: Body, rng: np.random.Generator) -> Task:
    """Return a task whose start lies in a pocket, which the car must leave in reverse.

    The pocket is a wall of one cell ahead of the body, and one on each side, of any length.

    Raises:
        NoTaskError: if no pocket leaves room for the body.
    """
    frame, cells = task.world.grid.frame, task.world.grid.cells
    cos, sin = math.cos(task.start[2]), math.sin(task.start[2])
    for _ in range(TRIES):
        gaps = rng.uniform(NARROWEST, WIDEST, 3) + frame.resolution
        front, left = body.half_length + gaps[0], body.half_width + gaps[1]
        right, back = -body.half_width - gaps[2], front - 2.0 * front * rng.random()
        corners = np.array([(back, left), (front, left), (front, right), (back, right)])
        line = np.vstack(list(_lines(corners, 0.2 * frame.resolution)))
        places = line @ np.array([[cos, sin], [-sin, cos]]) + task.start[:2]
        inside, rows, cols = frame.locate(places)
        if not inside.all():
            continue
        walled = cells.copy()
        walled[rows, cols] = OCCUPIED
        world = World(task.world.name, Grid(frame, walled))
        if _has_room(world, task.start, body):
            return replace(task, world=world)
    raise NoTaskError(f"{task.world.name}: no pocket has room for the body")


def _lines(corners: NDArray[np.float64], spacing: float) -> Iterator[NDArray[np.float64]]:
    """Yield points at most `spacing` apart on the lines from corner to corner, (n, 2) each."""
    for a, b in pairwise(corners):
        count = max(1, math.ceil(math.dist(a, b) / spacing))
        yield a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a)


def on_lattice(task: Task, body: Body, rng: np.random.Generator) -> Task:
    """Return a task whose start lies in the corner of cells, at a multiple of 45°.

    Raises:
        NoTaskError: if the body has no room there.
    """
    frame = task.world.grid.frame
    cells = np.round((np.array(task.start[:2]) - frame.origin) / frame.resolution)
    x, y = np.array(frame.origin) + cells * frame.resolution
    for eighth in rng.permutation(8):
        start = (float(x), float(y), math.remainder(0.25 * math.pi * eighth, 2.0 * math.pi))
        if _has_room(task.world, start, body):
            return replace(task, start=start)
    raise NoTaskError(f"{task.world.name}: the body has no room in the corner of the cells")


def _has_room(world: World, start: tuple[float, float, float], body: Body) -> bool:
    """Return whether a body touches nothing, with the margin that the planner keeps."""
    # Twice the margin, so that the car can also move.
    grown = body.inflated(2.0 * CONTACT_MARGIN)
    scene = Scene(world.solid, *world.grid.frame.lattice, *grown.halves)
    return bool(first_contact(scene, np.array([start])) < 0)
