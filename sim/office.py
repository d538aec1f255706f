"""Floor plans of offices: rooms off corridors, doors, furniture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim.canvas import Canvas, Point

EXTENT = (36.0, 52.0), (24.0, 36.0)
"""Smallest and largest extent of a building along x, and along y [m]."""
WALL = 0.22
"""Thickness of a wall between rooms [m]. Towards a corridor it is half of that: over two cells."""
DOOR = (0.85, 1.1)
"""Narrowest and widest door [m]."""
CORNERS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
"""Signs of x and y at the corners of a box."""


@dataclass(frozen=True)
class Room:
    """An axis-aligned room between two corners, and the middle of its door [m]."""

    low: Point
    high: Point
    door: Point

    @property
    def middle(self) -> Point:
        """Middle of the room [m]."""
        return 0.5 * (self.low[0] + self.high[0]), 0.5 * (self.low[1] + self.high[1])


def draw_office(rng: np.random.Generator) -> Canvas:
    """Draw corridors, rooms beside them, their doors and their furniture."""
    size = (rng.uniform(*EXTENT[0]), rng.uniform(*EXTENT[1]))
    canvas = Canvas(size[0] + 1.0, size[1] + 1.0)
    edge = 0.5
    rows = _corridors(edge, edge + size[1], rng, between=(9.0, 13.0), ends=(4.0, 6.0))
    cols = _corridors(edge, edge + size[0], rng, between=(16.0, 26.0), ends=(7.0, 14.0))
    if not cols:
        middle = edge + 0.5 * size[0]
        cols = [(middle - 1.0, middle + 1.0)]
    top = min(edge + size[1], rows[-1][1] + rng.uniform(4.5, 6.5))
    for low, high in rows:
        canvas.room((edge, low), (edge + size[0], high))
    for low, high in cols:
        # Only from the first corridor to the last, so that the rooms outside keep their space.
        canvas.room((low, rows[0][0]), (high, rows[-1][1]))
    for index, (low, high) in enumerate(rows):
        above = rows[index + 1][0] if index + 1 < len(rows) else top
        below = rows[index - 1][1] if index else edge
        up = (high, 0.5 * (high + above) if index + 1 < len(rows) else above)
        down = (0.5 * (low + below) if index else below, low)
        for span, side in ((up, -1.0), (down, 1.0)):
            outer = (index == len(rows) - 1 and side < 0) or (index == 0 and side > 0)
            # Starts and ends of the stretches that the crossing corridors leave.
            crossing = () if outer else cols
            cuts = [edge, *(end for corridor in crossing for end in corridor), edge + size[0]]
            for left, right in zip(cuts[::2], cuts[1::2], strict=True):
                _room_row(canvas, (left, right), span, side, rng)
    return canvas


def _corridors(
    low: float,
    high: float,
    rng: np.random.Generator,
    between: tuple[float, float],
    ends: tuple[float, float],
) -> list[tuple[float, float]]:
    """Draw parallel corridors across a span, and return where each begins and ends [m].

    `between` and `ends` are the smallest and largest distance between two corridors, and from the
    span's ends [m].
    """
    corridors: list[tuple[float, float]] = []
    at = low + rng.uniform(*ends)
    while True:
        width = rng.uniform(1.8, 2.8)
        if at + width + ends[0] > high:
            return corridors
        corridors.append((at, at + width))
        at += width + rng.uniform(*between)


def _room_row(
    canvas: Canvas,
    x: tuple[float, float],
    y: tuple[float, float],
    side: float,
    rng: np.random.Generator,
) -> None:
    """Carve rooms side by side between two x and two y, with doors at the high y if side > 0."""
    count = max(1, round((x[1] - x[0]) / rng.uniform(3.2, 6.5)))
    inner = np.sort(rng.uniform(-0.2, 0.2, count - 1)) + np.arange(1, count)
    cuts = x[0] + (x[1] - x[0]) * np.concatenate([[0], inner, [count]]) / count
    for left, right in pairwise(cuts):
        half = 0.5 * WALL
        low, high = (left + half, y[0] + half), (right - half, y[1] - half)
        if min(high[0] - low[0], high[1] - low[1]) < 2.0 or rng.random() < 0.05:
            continue
        canvas.room(low, high)
        width = rng.uniform(*DOOR)
        at = rng.uniform(low[0] + 0.3 + 0.5 * width, high[0] - 0.3 - 0.5 * width)
        wall = y[1] if side > 0 else y[0]
        canvas.box((at, wall), (width, 3 * WALL), free=True)
        furnish(canvas, Room(low, high, (at, wall)), rng)


def furnish(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put furniture into a room, and keep its door clear; some rooms stay empty."""
    kind = rng.random()
    if kind < 0.15:
        return
    if kind < 0.35:
        _meeting_table(canvas, room, rng)
        return
    for _ in range(int(rng.integers(1, 5))):
        _desk(canvas, room, rng)
    for _ in range(int(rng.integers(0, 3))):
        size = (rng.uniform(0.8, 1.2), rng.uniform(0.4, 0.5))
        put(canvas, room, at_wall(room, size, rng))


def _desk(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put a desk at a wall, with its chair in front of it."""
    centre, size = at_wall(room, (rng.uniform(1.2, 1.8), rng.uniform(0.7, 0.8)), rng)
    if not put(canvas, room, (centre, size)):
        return
    # The chair stands at the long side that faces the middle of the room.
    axis = 0 if size[0] < size[1] else 1
    off = room.middle[axis] - centre[axis]
    away = math.copysign(0.5 * size[axis] + rng.uniform(0.3, 0.5), off)
    chair = list(centre)
    chair[axis] += away
    if math.dist(chair, room.door) > 1.2:
        canvas.disc((chair[0], chair[1]), rng.uniform(0.2, 0.28))


def _meeting_table(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put a table in the middle of a room, with chairs along a rectangular one."""
    wide, deep = room.high[0] - room.low[0], room.high[1] - room.low[1]
    size = (wide - 2.6, deep - 2.6)
    if min(size) < 0.6:
        return
    size = (min(size[0], 3.5), min(size[1], 3.5))
    centre = room.middle
    if min(size) > 1.4 and rng.random() < 0.4:
        canvas.disc(centre, 0.5 * min(size))
        return
    long_axis = 0 if size[0] > size[1] else 1
    table = (size[0], min(size[1], 1.4)) if long_axis == 0 else (min(size[0], 1.4), size[1])
    canvas.box(centre, table)
    for at in np.arange(-0.5 * table[long_axis] + 0.4, 0.5 * table[long_axis] - 0.3, 0.8):
        for sign in (-1, 1):
            aside = sign * (0.5 * table[1 - long_axis] + 0.2)
            chair = (at, aside) if long_axis == 0 else (aside, at)
            if rng.random() < 0.8:
                canvas.disc((centre[0] + chair[0], centre[1] + chair[1]), 0.22)


def at_wall(room: Room, size: Point, rng: np.random.Generator) -> tuple[Point, Point]:
    """Draw the centre and the extent of a box (length, depth) with its long side at a wall."""
    axis, end = int(rng.integers(2)), int(rng.integers(2))
    extent = (size[1], size[0]) if axis == 0 else size
    wall = (room.low, room.high)[end][axis]
    centre = [0.0, 0.0]
    centre[axis] = wall + (0.5 - end) * extent[axis]
    low, high = room.low[1 - axis], room.high[1 - axis]
    half = 0.5 * extent[1 - axis]
    centre[1 - axis] = rng.uniform(low + half, max(high - half, low + half + 0.01))
    return (centre[0], centre[1]), extent


def put(canvas: Canvas, room: Room, thing: tuple[Point, Point]) -> bool:
    """Fill a box, unless it blocks the door or overlaps something; return whether it was filled."""
    centre, size = thing
    dx = max(abs(centre[0] - room.door[0]) - 0.5 * size[0], 0.0)
    dy = max(abs(centre[1] - room.door[1]) - 0.5 * size[1], 0.0)
    if math.hypot(dx, dy) < 1.3:
        return False
    corners = [
        (centre[0] + 0.45 * sx * size[0], centre[1] + 0.45 * sy * size[1]) for sx, sy in CORNERS
    ]
    if not all(canvas.is_free(x, y) for x, y in [centre, *corners]):
        return False
    canvas.box(centre, size)
    return True
