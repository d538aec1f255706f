"""Buildings as they are: wings at all angles, and maps of them by architects and by robots.

A building consists of wings that passages join. An architect's plan is clean. A robot's map has
furniture, glass that the LIDAR saw or not, rooms seen through their doors only, and the errors of
mapping. The distributions are chosen such that the numbers of `sim.building_statistics` come near
those of real maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from sim.canvas import Canvas, Point, largest_piece
from sim.office import Room
from sim.robot_map import Mapping, disturb, survey
from sim.scanned_furniture import furnish_as_scanned
from sim.spaces import Door, Space, draw_doors, draw_leaf, largest_group, shared_wall
from sim.subdivision import Layout
from sim.turned_canvas import TurnedCanvas, rotated
from sim.wing import Port, Wing, draw_wing

LARGEST = 88.0
"""Largest extent of a building along x and along y [m]."""
SMALLEST = 350.0
"""Smallest area of the box around a building of one wing [m²]."""
STOPS = 4.5
"""Approximate distance between the places where a robot stops [m]."""
EDGE = 1.0
"""Width of the solid ground around a building [m]."""


@dataclass(frozen=True)
class Style(Layout):
    """Properties that the rooms of one building share.

    Attributes:
        mapping: how a robot mapped the building; None: it is an architect's plan.
        wings: number of wings at most.
        closed: share of the doors that are closed.
        ajar: share of the doors that stand ajar.
        stairs: share of the small rooms that are stairs, lifts or shafts.
        furnished: probability that a room has furniture.
        glass: probability that a wall between a room and a corridor is of glass.
        pillars: probability that a large room has pillars.
        niches: niches and cabinets per metre of corridor [1/m].
        stubs: probability that a room has a partial wall.
    """

    mapping: Mapping | None
    wings: int
    closed: float
    ajar: float
    stairs: float
    furnished: float
    glass: float
    pillars: float
    niches: float
    stubs: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Style:
        """Draw the style of a building."""
        by_robot = rng.random() < 0.45
        return cls(
            wall=float(rng.choice([rng.uniform(0.1, 0.2), rng.uniform(0.2, 0.45)])),
            corridor=rng.uniform(1.6, 3.2) if by_robot else rng.uniform(1.6, 4.0),
            deepest=rng.uniform(4.0, 9.0) if by_robot else rng.uniform(5.0, 12.0),
            room=rng.uniform(2.8, 7.0) if by_robot else rng.uniform(2.8, 11.0),
            halls=rng.uniform(0.0, 0.3),
            mapping=Mapping.drawn(rng) if by_robot else None,
            wings=int(rng.choice([1, 2, 3, 4], p=[0.25, 0.25, 0.25, 0.25])),
            closed=float(rng.choice([0.1, 0.3, 0.7] if by_robot else [0.0, 0.0, 0.1])),
            ajar=float(rng.choice([0.0, 0.2, 0.5])) if by_robot else 0.0,
            stairs=rng.uniform(0.0, 0.15),
            furnished=float(rng.choice([0.6, 1.0] if by_robot else [0.0, 0.0, 0.0, 0.0, 0.3])),
            glass=float(rng.choice([0.0, 0.0, 0.3])),
            pillars=rng.uniform(0.0, 0.3),
            niches=float(rng.choice([0.0, 0.05, 0.15])),
            stubs=rng.uniform(0.0, 0.2),
        )


@dataclass(frozen=True)
class Placed:
    """A wing at its place: the place of its lower-left corner [m], and its yaw [rad]."""

    wing: Wing
    origin: NDArray[np.float64]
    yaw: float

    def place(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (n, 2) of the wing's coordinates in those of the building [m]."""
        return self.origin + rotated(points, self.yaw)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the wing, (4, 2) [m]."""
        wide, high = self.wing.size
        return self.place(np.array([(0.0, 0.0), (wide, 0.0), (wide, high), (0.0, high)]))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (n, 2) lie in the wing, (n,)."""
        own = rotated(points - self.origin, -self.yaw)
        return np.asarray(((own > 0.0) & (own < self.wing.size)).all(axis=1))


Link = tuple[int, Port, int, Port]
"""A passage from a port of a wing to a port of another; wings are given by their numbers."""


def draw_as_built(rng: np.random.Generator) -> Canvas:
    """Draw a building, and return it on a canvas of its own."""
    style = Style.drawn(rng)
    placed, links = _arrange(style, rng)
    while math.prod(np.ptp(placed[0].corners, axis=0)) < SMALLEST and len(placed) == 1:
        placed, links = _arrange(style, rng)
    corners = np.concatenate([one.corners for one in placed])
    shift = EDGE - corners.min(axis=0)
    size = np.ptp(corners, axis=0) + 2 * EDGE
    placed = [Placed(one.wing, one.origin + shift, one.yaw) for one in placed]
    canvas = Canvas(float(size[0]), float(size[1]))
    views = [TurnedCanvas(canvas, (one.origin[0], one.origin[1]), one.yaw) for one in placed]
    stops = [_draw(view, one.wing, style, rng) for view, one in zip(views, placed, strict=True)]
    for link in links:
        stops.append(_join(canvas, placed, views, link, style))
    canvas.free = largest_piece(canvas.free)
    if style.mapping is not None:
        places = np.concatenate(stops)
        places += rng.uniform(-0.4, 0.4, places.shape)
        if not any(canvas.is_free(x, y) for x, y in places):
            # The largest piece is a room with closed doors that the robot did not mean to visit.
            row, col = rng.choice(np.argwhere(canvas.free))
            places = np.array([canvas.frame.centre(row, col)])
        survey(canvas, places, style.mapping, rng)
        disturb(canvas, style.mapping, rng)
    _thicken(canvas.free)
    canvas.free = largest_piece(canvas.free)
    return canvas


def _arrange(style: Style, rng: np.random.Generator) -> tuple[list[Placed], list[Link]]:
    """Place wings side by side, each joined to an earlier one by a passage."""
    askew = style.mapping is not None and rng.random() < 0.5
    yaw = rng.uniform(-math.pi, math.pi) if askew else 0.0
    placed = [Placed(draw_wing(style, rng), np.zeros(2), yaw)]
    links: list[Link] = []
    for _ in range(4 * (style.wings - 1)):
        if len(placed) == style.wings:
            break
        number = int(rng.integers(len(placed)))
        parent, wing = placed[number], draw_wing(style, rng)
        ports = parent.wing.ports
        out, entry = ports[rng.integers(len(ports))], wing.ports[rng.integers(len(wing.ports))]
        kink = rng.uniform(-0.9, 0.9) if rng.random() < 0.3 else 0.0
        yaw = parent.yaw + out.heading + math.pi - entry.heading + kink
        gap = 0.3 if rng.random() < 0.7 else rng.uniform(0.5, 10.0)
        heading = parent.yaw + out.heading
        end = parent.place(np.array([out.end]))[0]
        end = end + gap * np.array([math.cos(heading), math.sin(heading)])
        new = Placed(wing, end - rotated(np.array([entry.end]), yaw)[0], yaw)
        corners = np.concatenate([one.corners for one in [*placed, new]])
        if np.ptp(corners, axis=0).max() < LARGEST and not _overlap(new, placed):
            links.append((number, out, len(placed), entry))
            placed.append(new)
    return placed, links


def _overlap(new: Placed, placed: list[Placed]) -> bool:
    """Return whether a wing covers more than a twentieth of the others' area, or they of its."""
    unit = np.stack(np.meshgrid(*[np.linspace(0.02, 0.98, 15)] * 2), axis=-1).reshape(-1, 2)
    own = new.place(unit * new.wing.size)
    return any(
        other.contains(own).mean() > 0.05
        or new.contains(other.place(unit * other.wing.size)).mean() > 0.05
        for other in placed
    )


def _draw(
    canvas: TurnedCanvas, wing: Wing, style: Style, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw a wing, and return the places where a robot stops in it, (n, 2) [m]."""
    middle = (0.5 * wing.size[0], 0.5 * wing.size[1])
    canvas.box(middle, (wing.size[0] + style.wall, wing.size[1] + style.wall))
    spaces = [space for space in wing.spaces if space.corridor or not _left_out(space, style, rng)]
    if not spaces:
        spaces = [max(wing.spaces, key=lambda space: math.prod(space.size))]
    doors = draw_doors(spaces, style.wall, rng)
    joined = largest_group(len(spaces), [pair for pair, _ in doors])
    for number in joined:
        _carve(canvas, spaces[number], style, rng)
    entrances: dict[int, Door] = {}
    for pair, door in doors:
        if pair[0] not in joined:
            continue
        first, second = spaces[pair[0]], spaces[pair[1]]
        for number in pair:
            entrances.setdefault(number, door)
        passage = max(door[1]) > 2.3 or (first.corridor and second.corridor)
        if not passage and rng.random() < style.closed:
            _shut(canvas, first, door, style)
            continue
        canvas.box(*door, free=True)
        if not passage and max(door[1]) < 1.3 and rng.random() < style.ajar:
            draw_leaf(canvas, door, rng)
        if first.corridor != second.corridor and rng.random() < style.glass:
            _glaze(canvas, first, second, style, rng)
    for number in sorted(joined):
        space = spaces[number]
        if space.corridor and min(space.size) < 5.0:
            _niches(canvas, space, style, rng)
        elif number in entrances and rng.random() < style.furnished:
            room = Room(*space.inside(style.wall), entrances[number][0])
            furnish_as_scanned(canvas, room, rng)
    if style.mapping is None:
        return np.zeros((0, 2))
    return _stops(canvas, [spaces[number] for number in sorted(joined)], style.mapping, rng)


def _left_out(space: Space, style: Style, rng: np.random.Generator) -> bool:
    """Return whether a room is a staircase, a lift or a shaft, which no map shows as free."""
    return min(space.size) < 5.0 and rng.random() < style.stairs


def _carve(canvas: Canvas, space: Space, style: Style, rng: np.random.Generator) -> None:
    """Carve a space, and put pillars, rows of seats or a partial wall into it."""
    low, high = space.inside(style.wall)
    canvas.room(low, high)
    middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]))
    shortest = min(space.size)
    if not space.corridor and max(space.size) < 1.4 * shortest and rng.random() < 0.05:
        canvas.disc(middle, 0.5 * max(space.size) + 0.3, free=True)
    if shortest > 7.0:
        kind = rng.random()
        if kind < style.pillars:
            _pillars(canvas, low, high, rng)
        elif kind < style.pillars + 0.1 and style.mapping is not None:
            _rows_of_seats(canvas, low, high, rng)
    if not space.corridor and shortest > 3.0 and rng.random() < style.stubs:
        _partial_wall(canvas, low, high, style, rng)


def _pillars(canvas: Canvas, low: Point, high: Point, rng: np.random.Generator) -> None:
    """Put pillars into a hall, in rows."""
    pitch, size = rng.uniform(3.5, 7.0), rng.uniform(0.3, 0.7)
    square = rng.random() < 0.5
    for x in np.arange(low[0] + 0.5 * pitch, high[0] - 1.0, pitch):
        for y in np.arange(low[1] + 0.5 * pitch, high[1] - 1.0, pitch):
            if square:
                canvas.box((float(x), float(y)), (size, size))
            else:
                canvas.disc((float(x), float(y)), 0.5 * size)


def _rows_of_seats(canvas: Canvas, low: Point, high: Point, rng: np.random.Generator) -> None:
    """Put the rows of seats of an auditorium into a hall, with an aisle on each side."""
    axis = int(rng.integers(2))
    aisle, middle = rng.uniform(1.1, 1.8), 0.5 * (low[1 - axis] + high[1 - axis])
    half = 0.5 * (high[1 - axis] - low[1 - axis]) - aisle
    blocks = [(-half, half)] if half < 3.0 else [(-half, -0.6), (0.6, half)]
    pitch = rng.uniform(0.9, 1.1)
    for at in np.arange(low[axis] + 3.0, high[axis] - 1.5, pitch):
        for start, end in blocks:
            centre, size = [0.0, 0.0], [0.0, 0.0]
            centre[axis], centre[1 - axis] = float(at), middle + 0.5 * (start + end)
            size[axis], size[1 - axis] = 0.4, end - start
            canvas.box((centre[0], centre[1]), (size[0], size[1]))


def _partial_wall(
    canvas: Canvas, low: Point, high: Point, style: Style, rng: np.random.Generator
) -> None:
    """Put a wall into a room that ends before it reaches the other side."""
    axis = int(rng.integers(2))
    side = float(rng.choice([low[axis], high[axis]]))
    length = rng.uniform(0.2, 0.6) * (high[axis] - low[axis])
    centre, size = [0.0, 0.0], [0.0, 0.0]
    centre[axis], size[axis] = side, 2 * length
    centre[1 - axis] = rng.uniform(low[1 - axis] + 1.0, high[1 - axis] - 1.0)
    size[1 - axis] = max(style.wall, 0.1)
    canvas.box((centre[0], centre[1]), (size[0], size[1]))


def _shut(canvas: Canvas, first: Space, door: Door, style: Style) -> None:
    """Carve the recess of a closed door into a wall, on the side of a space."""
    (x, y), size = door
    recess = 0.5 * style.wall
    axis = 0 if size[0] < size[1] else 1
    centre, extent = [x, y], list(size)
    inwards = 0.5 * (first.low[axis] + first.high[axis]) - centre[axis]
    centre[axis] += math.copysign(0.5 * style.wall, inwards)
    extent[axis] = recess
    canvas.box((centre[0], centre[1]), (extent[0], extent[1]), free=True)


def _glaze(
    canvas: Canvas, first: Space, second: Space, style: Style, rng: np.random.Generator
) -> None:
    """Open a wall of glass where a LIDAR does not see it: altogether, or between its frames."""
    wall = shared_wall(first, second)
    if wall is None:
        return
    axis, at, low, high = wall
    low, high = low + 0.5 * style.wall, high - 0.5 * style.wall
    cuts = np.arange(low, high, rng.uniform(0.9, 2.0))
    seen = rng.choice([0.0, 0.5])
    for start in cuts:
        end = min(float(start + cuts[1] - cuts[0] if len(cuts) > 1 else high), high)
        if rng.random() < seen or end - start < 0.3:
            continue
        centre, size = [0.0, 0.0], [0.0, 0.0]
        centre[axis], size[axis] = at, style.wall + 0.2
        centre[1 - axis], size[1 - axis] = 0.5 * (float(start) + end), end - float(start) - 0.1
        canvas.box((centre[0], centre[1]), (size[0], size[1]), free=True)


def _niches(canvas: Canvas, space: Space, style: Style, rng: np.random.Generator) -> None:
    """Carve niches into the long walls of a corridor, and stand cabinets along them."""
    axis = 0 if space.size[0] > space.size[1] else 1
    for _ in range(rng.poisson(style.niches * space.size[axis])):
        at = [0.0, 0.0]
        at[axis] = rng.uniform(space.low[axis], space.high[axis])
        at[1 - axis] = float(rng.choice([space.low[1 - axis], space.high[1 - axis]]))
        long = rng.uniform(0.5, 2.0)
        deep = style.wall + 2 * rng.uniform(0.1, 0.4)
        size = (long, deep) if axis == 0 else (deep, long)
        canvas.box((at[0], at[1]), size, free=style.wall > 0.25 and rng.random() < 0.3)


def _stops(
    canvas: TurnedCanvas, spaces: list[Space], mapping: Mapping, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return where a robot stops: along all corridors, and in the rooms that it visits."""
    # The largest space is visited always, since a wing may have no corridor.
    largest = max(spaces, key=lambda space: math.prod(space.size))
    points = []
    for space in spaces:
        if not (space.corridor or space is largest or rng.random() < mapping.visited):
            continue
        counts = [max(1, round(extent / STOPS)) for extent in space.size]
        grids = [
            space.low[axis] + (np.arange(counts[axis]) + 0.5) * space.size[axis] / counts[axis]
            for axis in (0, 1)
        ]
        points.append(np.stack(np.meshgrid(*grids), axis=-1).reshape(-1, 2))
    return rotated(np.concatenate(points), canvas.yaw) + canvas.origin


def _join(
    canvas: Canvas, placed: list[Placed], views: list[TurnedCanvas], link: Link, style: Style
) -> NDArray[np.float64]:
    """Carve a passage between two wings, and return the places where a robot stops in it."""
    width = min(link[1].width, link[3].width)
    ends = []
    for number, port in ((link[0], link[1]), (link[2], link[3])):
        inner, outer = placed[number].place(np.array([port.start, port.end]))
        middle, length = 0.5 * (inner + outer), float(np.hypot(*(outer - inner)))
        yaw = placed[number].yaw + port.heading
        canvas.box((middle[0], middle[1]), (length, width + 2 * style.wall), yaw)
        ends.append((inner, outer, yaw))
    for inner, outer, yaw in ends:
        back = 0.5 * np.array([math.cos(yaw), math.sin(yaw)])
        start = inner - back
        canvas.passage((start[0], start[1]), (outer[0], outer[1]), width)
        canvas.disc((outer[0], outer[1]), 0.5 * width, free=True)
    first, last = ends[0][1], ends[1][1]
    canvas.passage((first[0], first[1]), (last[0], last[1]), width)
    return np.array([ends[0][0], first, last, ends[1][0]])


def _thicken(free: NDArray[np.bool_]) -> None:
    """Make walls that are one cell thick two cells thick, where they are longer than five cells."""
    for plane in (free, free.T):
        thin = plane[:, :-2] & ~plane[:, 1:-1] & plane[:, 2:]
        runs, _ = label(thin, np.ones((3, 3)))
        sizes = np.bincount(runs.ravel())
        sizes[0] = 0
        plane[:, 2:] &= ~(sizes > 5)[runs]
