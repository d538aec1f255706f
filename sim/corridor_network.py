"""Networks of corridors, grown at random: straights, bends, T-junctions, crossings, dead ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.canvas import Canvas, Point


@dataclass(frozen=True)
class CorridorsConfig:
    """Settings of a network's growth.

    Attributes:
        size: side of the square in which the network must lie [m].
        width: smallest and largest width of a corridor [m].
        length: smallest and largest length of a segment [m].
        segments: number of segments at which the growth stops.
        oblique: share of bends that are not right angles.
        gap: smallest width of solid ground between corridors that do not meet [m].
        reach: minimum length of the longest route from the first segment's start to an end [m].
    """

    size: float
    width: tuple[float, float]
    length: tuple[float, float]
    segments: int
    oblique: float = 0.0
    gap: float = 0.8
    reach: float = 40.0


@dataclass
class Segment:
    """A straight corridor.

    Attributes:
        start: start of the middle line [m].
        yaw: direction of the middle line [rad].
        length: length of the middle line [m].
        width: width of the corridor [m].
        parent: index of the segment at whose end this one starts; -1: it is the first one.
        depth: length of the route from the first segment's start to this one's end [m].
        children: indices of the segments that start at this one's end.
    """

    start: Point
    yaw: float
    length: float
    width: float
    parent: int
    depth: float = 0.0
    children: list[int] = field(default_factory=list)

    @property
    def end(self) -> Point:
        """End of the middle line [m]."""
        return self.at(self.length)

    def at(self, distance: float, aside: float = 0.0) -> Point:
        """Return the point at a distance along the middle line, and `aside` to its left [m]."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return (
            self.start[0] + distance * cos - aside * sin,
            self.start[1] + distance * sin + aside * cos,
        )


CORRIDOR = CorridorsConfig(62.0, (3.5, 10.0), (9.0, 22.0), 14, oblique=0.35, reach=45.0)
"""Settings of the networks of the family `corridor`."""


def draw_corridor(rng: np.random.Generator) -> Canvas:
    """Draw a network of wide corridors, without anything in them."""
    return draw_network(CORRIDOR, rng)[0]


def draw_network(config: CorridorsConfig, rng: np.random.Generator) -> tuple[Canvas, list[Segment]]:
    """Draw a network of corridors, and return it on a canvas of its own, with its segments.

    Raises:
        ValueError: if no network fits in, as in a square that is too small.
    """
    canvas, segments = Canvas(config.size, config.size), grow(config, rng)
    carve(canvas, segments)
    return canvas, segments


def grow(config: CorridorsConfig, rng: np.random.Generator) -> list[Segment]:
    """Grow a tree of segments; try again until it has the reach and half of the segments.

    Raises:
        ValueError: if no try succeeds, as in a square that is too small.
    """
    for _ in range(200):
        segments = _grow_once(config, rng)
        reached = max(s.depth for s in segments) >= config.reach
        if reached and len(segments) >= config.segments // 2:
            return segments
    raise ValueError(f"no network has a reach of {config.reach} m and satisfies {config}")


def carve(canvas: Canvas, segments: list[Segment]) -> None:
    """Carve corridors into a canvas; corners are square at right angles, and otherwise round."""
    for segment in segments:
        canvas.passage(segment.start, segment.end, segment.width)
        for child in (segments[i] for i in segment.children):
            if abs(math.sin(2 * (child.yaw - segment.yaw))) < 1e-6:
                widest = max(child.width, segment.width)
                depth = min(child.width, segment.width)
                turned = abs(math.sin(child.yaw - segment.yaw)) > 0.5
                size = (child.width, segment.width) if turned else (depth, widest)
                canvas.box(segment.end, size, segment.yaw, free=True)
            else:
                canvas.disc(segment.end, 0.5 * max(segment.width, child.width), free=True)


def is_solid(
    canvas: Canvas,
    config: CorridorsConfig,
    segment: Segment,
    along: NDArray[np.float64],
    aside: NDArray[np.float64],
) -> bool:
    """Return whether all points beside a segment lie in the square, in solid ground.

    The points are all pairs of a distance `along` and a distance `aside` the segment [m].
    """
    points = [segment.at(s, a) for s in along for a in aside]
    low, high = np.min(points), np.max(points)
    return low > 0.5 and high < config.size - 0.5 and not any(canvas.is_free(*p) for p in points)


def _grow_once(config: CorridorsConfig, rng: np.random.Generator) -> list[Segment]:
    """Grow segments from the ends of others, until there are enough or no end is left."""
    first = _first(config, rng)
    segments, open_ends = [first], [0]
    while open_ends and len(segments) < config.segments:
        # Mostly the newest end is continued: long corridors instead of many short branches.
        pick = -1 if rng.random() < 0.7 else int(rng.integers(len(open_ends)))
        index = open_ends.pop(pick)
        for turn in _turns(config, rng):
            child = _child(config, rng, segments, index, turn)
            if child is not None:
                segments.append(child)
                segments[index].children.append(len(segments) - 1)
                open_ends.append(len(segments) - 1)
    return segments


def _first(config: CorridorsConfig, rng: np.random.Generator) -> Segment:
    """Draw the first segment, which starts at a side of the square and leads inwards."""
    tilt = rng.uniform(-math.pi / 4, math.pi / 4) if rng.random() < config.oblique else 0.0
    length, width = rng.uniform(*config.length), rng.uniform(*config.width)
    side, along = int(rng.integers(4)), rng.uniform(0.25, 0.75) * config.size
    edge = 0.5 * config.width[1] + 1.5
    start = [(edge, along), (along, edge), (config.size - edge, along), (along, config.size - edge)]
    return Segment(start[side], side * math.pi / 2 + tilt, length, width, -1, length)


def _turns(config: CorridorsConfig, rng: np.random.Generator) -> list[float]:
    """Draw the turns [rad] of the corridors that go on from an end; none at a dead end."""
    right = math.pi / 2
    kind = rng.choice(6, p=[0.34, 0.14, 0.2, 0.16, 0.12, 0.04])
    turns = [[right], [0.0], [right, -right], [0.0, right], [0.0, right, -right], []][kind]
    sign = rng.choice((-1, 1))
    turns = [sign * turn for turn in turns]
    if len(turns) == 1 and rng.random() < config.oblique:
        turns = [sign * math.radians(rng.uniform(25, 75))]
    return [turns[i] for i in rng.permutation(len(turns))]


def _child(
    config: CorridorsConfig,
    rng: np.random.Generator,
    segments: list[Segment],
    index: int,
    turn: float,
) -> Segment | None:
    """Draw a segment that starts at the end of another and fits in; None if no try fits."""
    parent = segments[index]
    for _ in range(6):
        # Half of the segments keep their parent's width, as most corridors of real buildings do.
        width = parent.width if rng.random() < 0.5 else rng.uniform(*config.width)
        length = rng.uniform(*config.length)
        child = Segment(parent.end, parent.yaw + turn, length, width, index, parent.depth + length)
        if _fits(config, segments, child):
            return child
    return None


def _fits(config: CorridorsConfig, segments: list[Segment], child: Segment) -> bool:
    """Return whether a segment lies in the square and keeps its distance from the others."""
    edge = 0.5 * child.width + 0.5
    if not all(edge <= value <= config.size - edge for value in child.end):
        return False
    parent = segments[child.parent]
    # Up to this distance from its start, a segment overlaps its parent and siblings.
    skip = 0.5 * (parent.width + child.width) + config.gap
    if child.length < skip + 1.0:
        return False
    for index, other in enumerate(segments):
        clear = 0.5 * (child.width + other.width) + config.gap
        kin = index == child.parent or other.parent == child.parent
        for s in np.arange(skip if kin else 0.0, child.length + 0.5 * child.width, 0.5):
            if _distance(child.at(float(s)), other) < (0.9 * clear if kin else clear):
                return False
    return True


def _distance(point: Point, segment: Segment) -> float:
    """Return the distance from a point to a segment's middle line [m]."""
    dx, dy = point[0] - segment.start[0], point[1] - segment.start[1]
    along = dx * math.cos(segment.yaw) + dy * math.sin(segment.yaw)
    return math.dist(point, segment.at(min(max(along, 0.0), segment.length)))
