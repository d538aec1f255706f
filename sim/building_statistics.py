"""Numbers that describe a building, to compare generated ones with maps of real ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import ConvexHull

from foresee.mapping.grid import FREE, OCCUPIED
from sim.canvas import largest_piece
from sim.lidar import cast_rays
from sim.world import World

HALF_DOOR = 0.65
"""Half the width of a passage that counts as a door [m]; a wider one joins two rooms into one."""
ROOM = 1.0
"""Least area of a room's part that is farther than `HALF_DOOR` from walls [m²]."""
SMALL = 0.5
"""Area of the largest small obstacle [m²]."""
SIGHT = 20.0
"""Longest range of the rays [m]."""
PLACES, RAYS = 200, 36
"""Number of places from which rays are cast, and of rays from each."""

STATISTICS = {
    "extent": "larger extent [m]",
    "area": "free area [m²]",
    "filled": "share of the convex hull that is free",
    "rooms": "rooms per 100 m²",
    "clearance_low": "distance to the nearest wall, lower quartile [m]",
    "clearance": "distance to the nearest wall, median [m]",
    "clearance_high": "distance to the nearest wall, upper quartile [m]",
    "sight_low": "range of a ray, lower quartile [m]",
    "sight": "range of a ray, median [m]",
    "sight_high": "range of a ray, upper quartile [m]",
    "walls": "length of walls per free area [m/m²]",
    "small": "obstacles of less than 0.5 m² per 100 m²",
}
"""Name of a statistic → what it is."""


def building_statistics(world: World, rng: np.random.Generator) -> dict[str, float]:
    """Return the `STATISTICS` of the largest connected piece of a building's free space.

    Rooms are pieces of the free space that doors separate. Distances and ranges are those at places
    that are drawn uniformly from the free space; a ray ends at the latest after `SIGHT`.

    Args:
        world: the building.
        rng: source of the places from which rays are cast.

    Raises:
        ValueError: if the building has no free space.
    """
    side = world.grid.frame.resolution
    free = largest_piece(world.grid.free)
    cells = np.argwhere(free)
    area = len(cells) * side**2
    distance = world.clearance[free] - 0.5 * side
    ranges = side * _ranges(world, cells, rng)
    low, middle, high = np.quantile(distance, [0.25, 0.5, 0.75])
    near, halfway, far = np.quantile(ranges, [0.25, 0.5, 0.75])
    edges = sum(int((np.diff(free, axis=axis)).sum()) for axis in (0, 1))
    return {
        "extent": float(side * (np.ptp(cells, axis=0).max() + 1)),
        "area": area,
        "filled": len(cells) / float(ConvexHull(_outline(free)).volume),
        "rooms": 100 * _rooms(world, free) / area,
        "clearance_low": float(low),
        "clearance": float(middle),
        "clearance_high": float(high),
        "sight_low": float(near),
        "sight": float(halfway),
        "sight_high": float(far),
        # Edges of cells are on average 4/π times as long as the line that they follow.
        "walls": edges * side * math.pi / 4 / area,
        "small": 100 * _small(free, side) / area,
    }


def _outline(free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the corners of the first and the last free cell in each row, (n, 2) [cells]."""
    rows = np.flatnonzero(free.any(axis=1))
    first = free[rows].argmax(axis=1)
    last = free.shape[1] - free[rows, ::-1].argmax(axis=1)
    ends = [(row + up, col) for col in (first, last) for up in (0, 1) for row in (rows,)]
    return np.concatenate([np.stack(end, axis=1) for end in ends]).astype(float)


def _ranges(world: World, cells: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the ranges of rays in all directions from random places, (n,) [cells]."""
    angles = np.linspace(0.0, 2 * math.pi, RAYS, endpoint=False)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    longest = SIGHT / world.grid.frame.resolution
    # All that is not free ends a ray.
    solid = np.where(world.solid, np.int8(OCCUPIED), np.int8(FREE))
    ranges = [
        cast_rays(world.skips, solid, col + 0.5, row + 0.5, rng.uniform(-3.0, 3.0), beams, longest)
        for row, col in rng.choice(cells, PLACES)
    ]
    return np.minimum(np.nan_to_num(np.concatenate(ranges), nan=longest), longest)


def _rooms(world: World, free: NDArray[np.bool_]) -> int:
    """Return the number of pieces of the free space that doors separate."""
    pieces, _ = label(free & (world.clearance > HALF_DOOR))
    areas = np.bincount(pieces.ravel())[1:] * world.grid.frame.resolution**2
    return int((areas >= ROOM).sum())


def _small(free: NDArray[np.bool_], side: float) -> int:
    """Return the number of obstacles in the free space that are small."""
    pieces, _ = label(~free, np.ones((3, 3)))
    edges = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    areas = np.bincount(pieces.ravel()) * side**2
    areas[np.unique(edges)] = np.inf
    return int((areas[1:] < SMALL).sum())
