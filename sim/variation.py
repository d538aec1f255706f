"""Variations of a building: turned, scaled, or with objects standing in it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import affine_transform

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.world import World

SCALES = (0.85, 1.25)
"""Smallest and largest factor by which a building is scaled."""
CLUTTER = (0.01, 0.08)
"""Lowest and highest density of objects in a cluttered building [1/m²]."""


def varied(world: World, rng: np.random.Generator) -> World:
    """Return a building turned, scaled and cluttered, each with a probability of one half."""
    angle = rng.uniform(-math.pi, math.pi) if rng.random() < 0.5 else 0.0
    scale = rng.uniform(*SCALES) if rng.random() < 0.5 else 1.0
    if angle or scale != 1.0:
        world = turned(world, angle, scale)
    if rng.random() < 0.5:
        world = cluttered(world, rng.uniform(*CLUTTER), rng)
    return world


def turned(world: World, angle: float, scale: float = 1.0) -> World:
    """Return a building turned by an angle [rad] and scaled, with cells of the same size."""
    cells, resolution = world.grid.cells, world.grid.frame.resolution
    cos, sin = math.cos(angle), math.sin(angle)
    rows, cols = cells.shape
    high = math.ceil(scale * (abs(rows * cos) + abs(cols * sin)) - 1e-9)
    wide = math.ceil(scale * (abs(cols * cos) + abs(rows * sin)) - 1e-9)
    back = np.array([[cos, -sin], [sin, cos]]) / scale
    middle = 0.5 * np.array([rows - 1, cols - 1])
    offset = middle - back @ (0.5 * np.array([high - 1, wide - 1]))
    turned_cells = affine_transform(
        cells, back, offset, (high, wide), order=0, mode="constant", cval=UNKNOWN
    )
    return World(world.name, Grid(GridFrame(resolution, (0.0, 0.0), (high, wide)), turned_cells))


def cluttered(world: World, density: float, rng: np.random.Generator) -> World:
    """Return a building with boxes and posts of 0.1–1 m standing on its floor.

    Args:
        world: the building.
        density: number of objects per square metre of free space [1/m²].
        rng: source of the objects' places and shapes.
    """
    resolution = world.grid.frame.resolution
    cells = world.grid.cells.copy()
    free = np.argwhere(cells == FREE)
    for _ in range(rng.poisson(density * len(free) * resolution**2)):
        row, col = free[rng.integers(len(free))]
        _put(cells, int(row), int(col), resolution, rng)
    return World(world.name, Grid(world.grid.frame, cells))


def _put(
    cells: NDArray[np.int8], row: int, col: int, resolution: float, rng: np.random.Generator
) -> None:
    """Put a turned box, or a post, on the free cells around a given cell."""
    box = rng.random() < 0.5
    length, width = rng.uniform(0.15, 1.0, 2) if box else np.full(2, rng.uniform(0.1, 0.6))
    yaw = rng.uniform(-math.pi, math.pi)
    reach = math.ceil(0.5 * math.hypot(length, width) / resolution)
    r0, c0 = max(0, row - reach), max(0, col - reach)
    part = cells[r0 : row + reach + 1, c0 : col + reach + 1]
    dy = (np.arange(r0, r0 + part.shape[0]) - row)[:, None] * resolution
    dx = (np.arange(c0, c0 + part.shape[1]) - col)[None, :] * resolution
    along = abs(dx * math.cos(yaw) + dy * math.sin(yaw)) / (0.5 * length)
    across = abs(dy * math.cos(yaw) - dx * math.sin(yaw)) / (0.5 * width)
    inside = np.maximum(along, across) <= 1.0 if box else along**2 + across**2 <= 1.0
    part[inside & (part == FREE)] = OCCUPIED
