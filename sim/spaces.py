"""Spaces of a building, the rooms and corridors, and the doors between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from sim.canvas import Canvas, Point

SHARED = 1.3
"""Minimum length of a wall between two spaces into which a door fits [m]."""


@dataclass(frozen=True)
class Space:
    """A room or a corridor: an axis-aligned rectangle between two corners [m]."""

    low: Point
    high: Point
    corridor: bool = False

    @property
    def size(self) -> Point:
        """Extent along x and along y [m]."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def inside(self, wall: float) -> tuple[Point, Point]:
        """Return the corners of the space inside walls of a thickness [m]."""
        half = 0.5 * wall
        low = (self.low[0] + half, self.low[1] + half)
        return low, (self.high[0] - half, self.high[1] - half)


def between(space: Space, axis: int, start: float, end: float, corridor: bool = False) -> Space:
    """Return the part of a rectangle between two coordinates on an axis."""
    low, high = list(space.low), list(space.high)
    low[axis], high[axis] = start, end
    return Space((low[0], low[1]), (high[0], high[1]), corridor)


Door = tuple[Point, Point]
"""Centre and extent along x and y of an opening in a wall [m]."""


def draw_doors(
    spaces: list[Space], thickness: float, rng: np.random.Generator
) -> list[tuple[tuple[int, int], Door]]:
    """Draw doors that join all spaces that can be joined, and some more.

    Args:
        spaces: rooms and corridors.
        thickness: thickness of walls [m].
        rng: source of the doors' places and widths.

    Returns:
        The numbers of the two spaces that each door joins, and the door.
    """
    walls = {}
    for pair in combinations(range(len(spaces)), 2):
        wall = shared_wall(spaces[pair[0]], spaces[pair[1]])
        if wall is not None:
            walls[pair] = wall
    if not walls:
        return []
    corridors = {pair: sum(spaces[n].corridor for n in pair) for pair in walls}
    # A room has its door to a corridor rather than to another room.
    price = [rng.uniform(0.5, 1.0) + 2.0 * (2 - corridors[pair]) for pair in walls]
    rows, cols = np.array(list(walls)).T
    graph = coo_array((price, (rows, cols)), shape=(len(spaces), len(spaces)))
    tree = minimum_spanning_tree(graph).tocoo()
    needed = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    more = {0: 0.08, 1: 0.2, 2: 1.0}
    chosen = [pair for pair in walls if pair in needed or rng.random() < more[corridors[pair]]]
    return [(pair, _door(walls[pair], corridors[pair] == 2, thickness, rng)) for pair in chosen]


def shared_wall(a: Space, b: Space) -> tuple[int, float, float, float] | None:
    """Return the wall that two spaces share, if a door fits into it.

    Returns:
        Axis across the wall, the wall's coordinate on it, and its ends on the other axis [m].
    """
    for axis in (0, 1):
        low = max(a.low[1 - axis], b.low[1 - axis])
        high = min(a.high[1 - axis], b.high[1 - axis])
        for first, second in ((a, b), (b, a)):
            if abs(first.high[axis] - second.low[axis]) < 1e-6 and high - low > SHARED:
                return axis, second.low[axis], low, high
    return None


def _door(
    wall: tuple[int, float, float, float], wide: bool, thickness: float, rng: np.random.Generator
) -> Door:
    axis, at, low, high = wall
    free = high - low - thickness - 0.1
    kind = rng.random()
    if wide or kind < 0.06:
        width = free * (1.0 if wide and kind < 0.8 else rng.uniform(0.5, 0.9))
    else:
        width = rng.uniform(0.8, 1.15) if kind < 0.85 else rng.uniform(1.3, 2.2)
    width = min(width, free)
    slack = 0.5 * (free - width)
    # Doors are at an end of the wall more often than in its middle.
    aside = slack * (rng.choice([-1.0, 1.0]) if rng.random() < 0.5 else rng.uniform(-1.0, 1.0))
    middle, deep = 0.5 * (low + high) + aside, thickness + 0.2
    return ((at, middle), (deep, width)) if axis == 0 else ((middle, at), (width, deep))


def largest_group(count: int, pairs: list[tuple[int, int]]) -> set[int]:
    """Return the numbers of the spaces in the largest group that doors join."""
    groups = [{number} for number in range(count)]
    for first, second in pairs:
        if groups[first] is not groups[second]:
            groups[first] |= groups[second]
            for number in groups[second]:
                groups[number] = groups[first]
    return max(groups, key=len)


def draw_leaf(canvas: Canvas, door: Door, rng: np.random.Generator) -> None:
    """Put the leaf of a door that stands ajar, turned about an end of the opening."""
    (x, y), (wide, high) = door
    length, along = (high, math.pi / 2) if high > wide else (wide, 0.0)
    end = rng.choice([-1.0, 1.0])
    hinge = (x + 0.5 * end * length * math.cos(along), y + 0.5 * end * length * math.sin(along))
    opened = along + rng.choice([-1.0, 1.0]) * rng.uniform(math.radians(35), math.radians(110))
    away = -0.5 * end * length
    middle = (hinge[0] + away * math.cos(opened), hinge[1] + away * math.sin(opened))
    canvas.box(middle, (length, 0.1), opened)
