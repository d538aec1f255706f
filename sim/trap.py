"""Corridors that mislead: obstacles just behind blind corners, dead ends that seem to go on."""

from __future__ import annotations

import math

import numpy as np

from sim.canvas import Canvas
from sim.corridor_network import CorridorsConfig, Segment, draw_network, is_solid

NETWORK = CorridorsConfig(60.0, (2.4, 4.5), (8.0, 16.0), 16, oblique=0.15, gap=1.0, reach=50.0)
"""Settings of the network of corridors."""
PASSAGE = 1.5
"""Width that an obstacle leaves open beside it [m]."""


def draw_trap(rng: np.random.Generator) -> Canvas:
    """Draw corridors with obstacles behind their corners, and false ends."""
    canvas, segments = draw_network(NETWORK, rng)
    for segment in segments:
        if segment.parent >= 0:
            parent = segments[segment.parent]
            turn = math.remainder(segment.yaw - parent.yaw, 2 * math.pi)
            if abs(turn) > 0.3 and rng.random() < 0.75:
                _behind_corner(canvas, parent, segment, math.copysign(1.0, turn), rng)
        if not segment.children and rng.random() < 0.7:
            _false_end(canvas, segment, rng)
    return canvas


def _behind_corner(
    canvas: Canvas, parent: Segment, segment: Segment, turn: float, rng: np.random.Generator
) -> None:
    """Put an obstacle where a corner hides it until the car is in the bend."""
    room = segment.width - PASSAGE
    if room < 0.4:
        return
    size = (rng.uniform(0.4, 1.2), rng.uniform(0.4, min(room, 1.8)))
    # Just past the mouth, at the inner wall, where the corner hides it longest.
    at = 0.5 * parent.width + rng.uniform(0.3, 1.5) + 0.5 * size[0]
    inner = 0.5 * segment.width - 0.5 * size[1]
    aside = turn * inner * rng.choice((1.0, 1.0, 0.0 if room > 2 * PASSAGE else 1.0, -1.0))
    if at + 0.5 * size[0] + 1.5 > segment.length:
        return
    if abs(size[0] - size[1]) < 0.3 and rng.random() < 0.5:
        canvas.disc(segment.at(at, aside), 0.5 * min(size))
    else:
        canvas.box(segment.at(at, aside), size, segment.yaw)


def _false_end(canvas: Canvas, segment: Segment, rng: np.random.Generator) -> None:
    """Make a dead end look like a corridor that goes on: carve a short stub round a bend."""
    side = rng.choice((-1.0, 1.0))
    depth = rng.uniform(1.2, 3.0)
    width = min(segment.width, 3.0)
    at = segment.length - 0.5 * width
    wall = 0.5 * segment.width
    along = at + np.arange(-0.5 * width - 0.4, 0.5 * width + 0.41, 0.2)
    across = side * np.arange(wall + 0.1, wall + depth + 0.5, 0.2)
    if not is_solid(canvas, NETWORK, segment, along, across):
        return
    middle = segment.at(at, side * (wall + 0.5 * depth - 0.1))
    canvas.box(middle, (width, depth + 0.2), segment.yaw, free=True)
