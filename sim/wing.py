"""Wings of a building: rooms along a corridor, around a courtyard, a deep block, a large hall.

A wing is laid out in coordinates of its own, with (0, 0) at its lower-left corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.canvas import Point
from sim.spaces import Space, between
from sim.subdivision import Layout, divided, row_of_rooms

LONGEST = 80.0
"""Largest length of a wing [m]."""


@dataclass(frozen=True)
class Port:
    """A place where a passage can leave a wing.

    Attributes:
        start: point at the edge of a corridor or hall [m].
        end: point on the wing's edge [m].
        heading: direction in which the passage leaves [rad].
        width: width of the passage [m].
    """

    start: Point
    end: Point
    heading: float
    width: float


@dataclass(frozen=True)
class Wing:
    """Rooms and corridors in a rectangle.

    Attributes:
        size: extent along x and along y [m].
        spaces: the rooms and corridors.
        ports: where passages can leave.
    """

    size: Point
    spaces: tuple[Space, ...]
    ports: tuple[Port, ...]


def draw_wing(layout: Layout, rng: np.random.Generator) -> Wing:
    """Draw a wing."""
    kind = rng.choice(4, p=[0.45, 0.15, 0.25, 0.15])
    draw = (_along_corridor, _around_courtyard, _deep_block, _hall)[int(kind)]
    return draw(layout, rng)


def _along_corridor(layout: Layout, rng: np.random.Generator) -> Wing:
    """Rooms on one side of a corridor, or on both."""
    length = min(LONGEST, 14.0 + rng.exponential(18.0))
    width = layout.corridor * rng.uniform(0.85, 1.2)
    below, above = layout.deepest * rng.uniform(0.6, 1.1, 2)
    if rng.random() < 0.3:
        below = 0.0
    whole = Space((0.0, 0.0), (length, below + width + above))
    corridor = between(whole, 1, below, below + width, corridor=True)
    spaces = [corridor]
    for low, high in ((0.0, below), (below + width, below + width + above)):
        if high > low:
            spaces += _row(between(whole, 1, low, high), layout, rng)
    return _with_ports(whole, spaces, rng)


def _row(row: Space, layout: Layout, rng: np.random.Generator) -> list[Space]:
    """Rooms side by side along x, some of them divided again."""
    spaces: list[Space] = []
    for room in row_of_rooms(row, 0, layout, rng):
        if rng.random() < 0.12 and min(room.size) > 3.0:
            spaces += _cells(room, rng)
        else:
            spaces.append(room)
    return spaces


def _cells(room: Space, rng: np.random.Generator) -> list[Space]:
    """Divide a room into a lobby and small cells, as of lavatories, stores and booths."""
    axis = int(rng.integers(2))
    low, high = room.low[axis], room.high[axis]
    cut = low + rng.uniform(0.35, 0.65) * (high - low)
    lobby, rest = between(room, axis, low, cut), between(room, axis, cut, high)
    if rng.random() < 0.5:
        lobby, rest = rest, lobby
    count = max(1, round(rest.size[1 - axis] / rng.uniform(1.5, 3.0)))
    cuts = np.linspace(rest.low[1 - axis], rest.high[1 - axis], count + 1)
    cells = [between(rest, 1 - axis, float(cuts[i]), float(cuts[i + 1])) for i in range(count)]
    return [lobby, *cells]


def _around_courtyard(layout: Layout, rng: np.random.Generator) -> Wing:
    """Rooms outside of a corridor that runs around a courtyard or a core of rooms."""
    deep, width = layout.deepest * rng.uniform(0.6, 1.0), layout.corridor
    inner = rng.uniform(5.0, 22.0), rng.uniform(4.0, 14.0)
    x = (0.0, deep, deep + width, deep + width + inner[0])
    y = (0.0, deep, deep + width, deep + width + inner[1])
    end = (x[3] + width, y[3] + width)
    size = (end[0] + deep, end[1] + deep)
    whole = Space((0.0, 0.0), size)
    ring = [
        Space((x[1], y[1]), (end[0], y[2]), True),
        Space((x[1], y[3]), (end[0], end[1]), True),
        Space((x[1], y[2]), (x[2], y[3]), True),
        Space((x[3], y[2]), (end[0], y[3]), True),
    ]
    spaces = list(ring)
    for row in (Space((0.0, 0.0), (size[0], deep)), Space((0.0, end[1]), size)):
        if rng.random() < 0.85:
            spaces += _row(row, layout, rng)
    for row in (Space((0.0, deep), (deep, end[1])), Space((end[0], deep), (size[0], end[1]))):
        if rng.random() < 0.85:
            spaces += row_of_rooms(row, 1, layout, rng)
    if rng.random() < 0.4:
        core = Space((x[2], y[2]), (x[3], y[3]))
        spaces += divided(core, replace(layout, deepest=min(layout.deepest, 6.0)), rng)
    return _with_ports(whole, spaces, rng)


def _deep_block(layout: Layout, rng: np.random.Generator) -> Wing:
    """Rooms and corridors in a rectangle that is divided again and again."""
    whole = Space((0.0, 0.0), (rng.uniform(16.0, 48.0), rng.uniform(14.0, 34.0)))
    return _with_ports(whole, list(divided(whole, layout, rng)), rng)


def _hall(layout: Layout, rng: np.random.Generator) -> Wing:
    """A lobby, a gymnasium or an auditorium, with or without side rooms."""
    whole = Space((0.0, 0.0), (rng.uniform(9.0, 26.0), rng.uniform(8.0, 18.0)))
    if rng.random() < 0.5:
        return _with_ports(whole, [replace(whole, corridor=True)], rng)
    cut = whole.size[1] - rng.uniform(2.5, 4.5)
    hall = between(whole, 1, 0.0, cut, corridor=True)
    row = between(whole, 1, cut, whole.size[1])
    return _with_ports(whole, [hall, *row_of_rooms(row, 0, layout, rng)], rng)


def _with_ports(whole: Space, spaces: list[Space], rng: np.random.Generator) -> Wing:
    """Return a wing with ports where its corridors end, and from their sides through the rooms."""
    ports = []
    sources = [space for space in spaces if space.corridor]
    if not sources:
        sources = [max(spaces, key=lambda space: math.prod(space.size))]
    for space in sources:
        for axis in (0, 1):
            span = space.size[1 - axis]
            for at, edge, turn in (
                (space.low[axis], whole.low[axis], math.pi),
                (space.high[axis], whole.high[axis], 0.0),
            ):
                if abs(at - edge) > 12.0:
                    continue
                through = span < 5.0
                width = span if through else rng.uniform(1.6, 3.2)
                middle = space.low[1 - axis] + 0.5 * span
                if not through:
                    slack = 0.5 * (span - width) - 0.2
                    middle += rng.uniform(-slack, slack)
                start, end = [0.0, 0.0], [0.0, 0.0]
                start[axis], end[axis] = at, edge
                start[1 - axis] = end[1 - axis] = middle
                heading = turn + axis * 0.5 * math.pi
                ports.append(Port((start[0], start[1]), (end[0], end[1]), heading, width))
    return Wing(whole.size, tuple(spaces), tuple(ports))
