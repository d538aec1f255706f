"""Networks of corridors, grown at random: straights, bends, T-junctions, crossings, dead ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sim.canvas import Canvas, Point


@dataclass(frozen=True)
class NetworkConfig:
    """Settings of a network's growth.

    Attributes:
        size: the square it must stay in [m].
        width: narrowest and widest corridor [m].
        length: shortest and longest segment [m].
        segments: when to stop.
        oblique: share of bends that are no right angles.
        gap: least solid ground between corridors that do not meet [m].
        reach: length of the longest way through it, at least [m].
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
    """A straight corridor; `parent` is the one that it starts from, `depth` the way to its end."""

    start: Point
    yaw: float
    length: float
    width: float
    parent: int
    depth: float = 0.0
    children: list[int] = field(default_factory=list)

    @property
    def end(self) -> Point:
        """Where its middle line ends [m]."""
        return self.at(self.length)

    def at(self, distance: float, aside: float = 0.0) -> Point:
        """Return the point at a distance along the middle line, and to the left of it [m]."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return (
            self.start[0] + distance * cos - aside * sin,
            self.start[1] + distance * sin + aside * cos,
        )


def grow(config: NetworkConfig, rng: np.random.Generator) -> list[Segment]:
    """Grow a tree of segments; try again until it has its reach and half of its segments.

    Raises:
        ValueError: if the square is too small for that.
    """
    for _ in range(200):
        segments = _grow_once(config, rng)
        reached = max(s.depth for s in segments) >= config.reach
        if reached and len(segments) >= config.segments // 2:
            return segments
    raise ValueError(f"no network has a reach of {config.reach} m and satisfies {config}")


def carve(canvas: Canvas, segments: list[Segment]) -> None:
    """Carve corridors into a canvas; a right-angled corner is square, any other is round."""
    for segment in segments:
        canvas.passage(segment.start, segment.end, segment.width)
        children = [segments[i] for i in segment.children]
        for child in children:
            if abs(math.sin(2 * (child.yaw - segment.yaw))) < 1e-6:
                widest = max(child.width, segment.width)
                depth = min(child.width, segment.width)
                turned = abs(math.sin(child.yaw - segment.yaw)) > 0.5
                size = (child.width, segment.width) if turned else (depth, widest)
                canvas.box(segment.end, size, segment.yaw, free=True)
            else:
                canvas.disc(segment.end, 0.5 * max(segment.width, child.width), free=True)


def _grow_once(config: NetworkConfig, rng: np.random.Generator) -> list[Segment]:
    first = _first(config, rng)
    segments, open_ends = [first], [0]
    while open_ends and len(segments) < config.segments:
        # The newest end first, mostly: long ways rather than bushes.
        pick = -1 if rng.random() < 0.7 else int(rng.integers(len(open_ends)))
        index = open_ends.pop(pick)
        for turn in _turns(config, rng):
            child = _child(config, rng, segments, index, turn)
            if child is not None:
                segments.append(child)
                segments[index].children.append(len(segments) - 1)
                open_ends.append(len(segments) - 1)
    return segments


def _first(config: NetworkConfig, rng: np.random.Generator) -> Segment:
    tilt = rng.uniform(-math.pi / 4, math.pi / 4) if rng.random() < config.oblique else 0.0
    length, width = rng.uniform(*config.length), rng.uniform(*config.width)
    side, along = int(rng.integers(4)), rng.uniform(0.25, 0.75) * config.size
    edge = 0.5 * config.width[1] + 1.5
    start = [(edge, along), (along, edge), (config.size - edge, along), (along, config.size - edge)]
    return Segment(start[side], side * math.pi / 2 + tilt, length, width, -1, length)


def _turns(config: NetworkConfig, rng: np.random.Generator) -> list[float]:
    """Draw the directions in which a corridor goes on from its end: a bend, a T, a crossing."""
    right = math.pi / 2
    kind = rng.choice(6, p=[0.34, 0.14, 0.2, 0.16, 0.12, 0.04])
    turns = [[right], [0.0], [right, -right], [0.0, right], [0.0, right, -right], []][kind]
    sign = rng.choice((-1, 1))
    turns = [sign * turn for turn in turns]
    if len(turns) == 1 and rng.random() < config.oblique:
        turns = [sign * math.radians(rng.uniform(25, 75))]
    return [turns[i] for i in rng.permutation(len(turns))]


def _child(
    config: NetworkConfig,
    rng: np.random.Generator,
    segments: list[Segment],
    index: int,
    turn: float,
) -> Segment | None:
    parent = segments[index]
    narrow, wide = config.width
    for _ in range(6):
        # Mostly as wide as before: real corridors are.
        width = parent.width if rng.random() < 0.5 else rng.uniform(narrow, wide)
        length = rng.uniform(*config.length)
        start = parent.end
        child = Segment(start, parent.yaw + turn, length, width, index, parent.depth + length)
        if _fits(config, segments, child):
            return child
    return None


def _fits(config: NetworkConfig, segments: list[Segment], child: Segment) -> bool:
    edge = 0.5 * child.width + 0.5
    if not all(edge <= value <= config.size - edge for value in child.end):
        return False
    parent = segments[child.parent]
    # Near its start it must touch its parent and siblings; from here on it is on its own.
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
    dx, dy = point[0] - segment.start[0], point[1] - segment.start[1]
    along = dx * math.cos(segment.yaw) + dy * math.sin(segment.yaw)
    return math.dist(point, segment.at(min(max(along, 0.0), segment.length)))
