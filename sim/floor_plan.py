"""Floor plans like those of real buildings: rooms wall to wall, off corridors and off each other.

They resemble architects' plans and maps made by robots, but no number is measured in any of these.
They have thin or thick walls, rows of equal rooms and large halls, courtyards, doors ajar,
furniture along walls, rooms that nobody mapped, ragged and curved walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, map_coordinates

from foresee.mapping.conventions import RESOLUTION
from sim.canvas import Canvas, Point, largest_piece
from sim.office import Room, furnish
from sim.spaces import Door, Space, draw_doors, draw_leaf, largest_group
from sim.subdivision import Layout, divided

LARGEST = (62.0, 44.0)
"""Largest extent of a building along x and along y [m]."""


@dataclass(frozen=True)
class Style(Layout):
    """Properties that the rooms of one building share.

    Attributes:
        unmapped: share of the rooms that are left out, as if behind closed doors.
        furnished: probability that a room has furniture.
        ajar: probability that a door stands ajar.
        cabinets: number of cabinets per metre of corridor [1/m].
        ragged: share of the free cells along walls that are made solid.
    """

    unmapped: float
    furnished: float
    ajar: float
    cabinets: float
    ragged: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Style:
        """Draw the style of a building: an architect's plan, or a map made by a robot.

        A plan has clean walls and nearly all rooms. A robot's map has ragged walls, and lacks the
        rooms whose doors were closed. A predictor can therefore tell from the walls what to expect
        behind them.
        """
        by_robot = rng.random() < 0.4
        return cls(
            wall=float(rng.choice([rng.uniform(0.1, 0.2), rng.uniform(0.2, 0.45)])),
            corridor=rng.uniform(1.5, 3.5),
            deepest=rng.uniform(5.0, 11.0),
            room=rng.uniform(2.6, 8.0),
            halls=rng.uniform(0.0, 0.25),
            unmapped=float(rng.choice([0.05, 0.3, 0.7] if by_robot else [0.0, 0.0, 0.05])),
            furnished=float(rng.choice([0.0, 0.0, 0.4, 0.9])),
            ajar=float(rng.choice([0.0, 0.2, 0.6])),
            cabinets=float(rng.choice([0.0, 0.0, 0.1])),
            ragged=float(rng.choice([0.05, 0.1, 0.25])) if by_robot else 0.0,
        )


def draw_floor_plan(rng: np.random.Generator) -> Canvas:
    """Draw a floor plan, and return it on a canvas of its own."""
    style = Style.drawn(rng)
    size = (rng.uniform(24.0, LARGEST[0] - 2.0), rng.uniform(12.0, LARGEST[1] - 2.0))
    canvas = Canvas(size[0] + 2.0, size[1] + 2.0)
    whole = Space((1.0, 1.0), (1.0 + size[0], 1.0 + size[1]))
    spaces = list(divided(whole, style, rng))
    largest = max(spaces, key=lambda space: math.prod(space.size))
    if rng.random() < 0.5:
        spaces = _with_courtyard(spaces, whole, rng)
    spaces = [s for s in spaces if s.corridor or rng.random() >= style.unmapped] or [largest]
    doors = draw_doors(spaces, style.wall, rng)
    joined = largest_group(len(spaces), [pair for pair, _ in doors])
    for number in sorted(joined):
        _carve(canvas, spaces[number], style, rng)
    for (number, _), (centre, extent) in doors:
        if number in joined:
            canvas.box(centre, extent, free=True)
    entrances: dict[int, Door] = {}
    for pair, door in doors:
        for number in pair:
            entrances.setdefault(number, door)
        if pair[0] in joined and max(door[1]) < 1.3 and rng.random() < style.ajar:
            draw_leaf(canvas, door, rng)
    for number in sorted(joined):
        if spaces[number].corridor:
            _cabinets(canvas, spaces[number], style, rng)
        elif number in entrances:
            _furnish(canvas, spaces[number], entrances[number], style, rng)
    _roughen(canvas, style, rng)
    canvas.free = largest_piece(canvas.free)
    return _bent(canvas, rng) if rng.random() < 0.15 else canvas


def _with_courtyard(spaces: list[Space], whole: Space, rng: np.random.Generator) -> list[Space]:
    """Return the spaces without the rooms in a rectangle: a courtyard, or the gap of an L or U."""
    centre = [rng.uniform(whole.low[axis], whole.high[axis]) for axis in (0, 1)]
    half = [rng.uniform(0.15, 0.35) * whole.size[axis] for axis in (0, 1)]

    def outside(space: Space) -> bool:
        middle = [0.5 * (space.low[axis] + space.high[axis]) for axis in (0, 1)]
        return any(abs(middle[axis] - centre[axis]) > half[axis] for axis in (0, 1))

    return [space for space in spaces if space.corridor or outside(space)]


def _carve(canvas: Canvas, space: Space, style: Style, rng: np.random.Generator) -> None:
    low, high = space.inside(style.wall)
    canvas.room(low, high)
    if space.corridor:
        return
    if min(space.size) > 3.5 and rng.random() < 0.1:
        _slanted(canvas, low, high, rng)
    if max(space.size) < 1.3 * min(space.size) and rng.random() < 0.06:
        # An apse or a bay: a round wall.
        middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]))
        canvas.disc(middle, 0.5 * max(space.size) + 0.3, free=True)
    if min(space.size) > 8.0 and rng.random() < 0.5:
        pitch, radius = rng.uniform(3.5, 6.0), rng.uniform(0.12, 0.35)
        for x in np.arange(low[0] + 0.6 * pitch, high[0] - 1.0, pitch):
            for y in np.arange(low[1] + 0.6 * pitch, high[1] - 1.0, pitch):
                canvas.disc((float(x), float(y)), radius)


def _slanted(canvas: Canvas, low: Point, high: Point, rng: np.random.Generator) -> None:
    """Cut off a corner of a room by a slanted wall."""
    row, col = canvas.frame.cell(*low)
    end_row, end_col = canvas.frame.cell(*high)
    x, y = canvas.x[col : end_col + 1], canvas.y[row : end_row + 1]
    dx = abs(x - rng.choice(np.array([low[0], high[0]])))[None, :]
    dy = abs(y - rng.choice(np.array([low[1], high[1]])))[:, None]
    cut = dx / rng.uniform(0.8, 2.5) + dy / rng.uniform(0.8, 2.5) < 1.0
    canvas.free[row : end_row + 1, col : end_col + 1] &= ~cut


def _furnish(
    canvas: Canvas, space: Space, door: Door, style: Style, rng: np.random.Generator
) -> None:
    if min(space.size) < 2.4 or rng.random() >= style.furnished:
        return
    furnish(canvas, Room(*space.inside(style.wall), door[0]), rng)


def _cabinets(canvas: Canvas, space: Space, style: Style, rng: np.random.Generator) -> None:
    """Stand cabinets along the long walls of a corridor."""
    axis = 0 if space.size[0] > space.size[1] else 1
    for _ in range(rng.poisson(style.cabinets * space.size[axis])):
        long, deep = rng.uniform(0.5, 2.0), rng.uniform(0.25, 0.45)
        at, wall = [0.0, 0.0], rng.choice([space.low[1 - axis], space.high[1 - axis]])
        at[axis] = rng.uniform(space.low[axis], space.high[axis])
        at[1 - axis] = wall
        deep += 0.5 * style.wall
        canvas.box((at[0], at[1]), (long, 2 * deep) if axis == 0 else (2 * deep, long))


def _roughen(canvas: Canvas, style: Style, rng: np.random.Generator) -> None:
    """Make some of the free cells along walls solid, in pieces of two cells."""
    if not style.ragged:
        return
    shape = canvas.free.shape
    coarse = rng.random((shape[0] // 2 + 1, shape[1] // 2 + 1)) < style.ragged
    pieces = coarse.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]
    canvas.free &= ~(pieces & binary_dilation(~canvas.free, np.ones((3, 3), dtype=bool)))


def _bent(canvas: Canvas, rng: np.random.Generator) -> Canvas:
    """Bend a building around a far point, so that its walls are curved."""
    rows, cols = canvas.free.shape
    width, height = cols * RESOLUTION, rows * RESOLUTION
    inner = rng.uniform(1.2, 3.0) * max(width / math.pi, height)
    angle = width / (inner + 0.5 * height)
    outer = inner + height
    bent = Canvas(2 * outer * math.sin(0.5 * angle) + 1.0, outer - inner * math.cos(0.5 * angle))
    dx = (bent.x - 0.5 * bent.frame.size[0])[None, :]
    dy = (bent.y + inner * math.cos(0.5 * angle))[:, None]
    col = (np.arctan2(dx, dy) / angle + 0.5) * cols - 0.5
    row = (np.hypot(dx, dy) - inner) / RESOLUTION - 0.5
    bent.free[:] = map_coordinates(canvas.free.astype(np.uint8), [row, col], order=0) > 0
    return bent
