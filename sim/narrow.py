"""Narrow corridors with door frames across them, and small rooms behind doors beside them."""

from __future__ import annotations

import numpy as np

from sim.canvas import Canvas
from sim.corridor_network import CorridorsConfig, Segment, draw_network, is_solid

NETWORK = CorridorsConfig(46.0, (1.5, 3.0), (5.0, 13.0), 22, oblique=0.1, gap=1.2, reach=45.0)
"""Settings of the network of corridors."""


def draw_narrow(rng: np.random.Generator) -> Canvas:
    """Draw narrow corridors, with doors across them and rooms beside them."""
    canvas, segments = draw_network(NETWORK, rng)
    for segment in segments:
        if segment.length > 5.0 and rng.random() < 0.6:
            at = rng.uniform(0.35, 0.65) * segment.length
            _door_frame(canvas, segment, at, rng)
        for side in (-1, 1):
            if rng.random() < 0.6:
                _side_room(canvas, segment, side, rng)
    return canvas


def _door_frame(canvas: Canvas, segment: Segment, at: float, rng: np.random.Generator) -> None:
    """Put a wall across a corridor, with a door in it."""
    door = rng.uniform(0.8, 1.0)
    slack = 0.5 * (segment.width - door) - 0.1
    aside = rng.uniform(-slack, slack)
    canvas.box(segment.at(at), (0.15, segment.width + 0.1), segment.yaw)
    canvas.box(segment.at(at, aside), (0.25, door), segment.yaw, free=True)


def _side_room(canvas: Canvas, segment: Segment, side: int, rng: np.random.Generator) -> None:
    """Carve a room beside a corridor, behind a door, if there is solid ground for it."""
    wide, deep = rng.uniform(2.5, 5.0), rng.uniform(2.5, 4.5)
    if segment.length < wide:
        return
    at = rng.uniform(0.5 * wide, segment.length - 0.5 * wide)
    wall = 0.5 * segment.width + 0.2
    # The room and the walls around it.
    along = at + np.arange(-0.5 * wide - 0.3, 0.5 * wide + 0.31, 0.1)
    across = side * np.arange(wall - 0.14, wall + deep + 0.31, 0.1)
    if not is_solid(canvas, NETWORK, segment, along, across):
        return
    canvas.box(segment.at(at, side * (wall + 0.5 * deep)), (wide, deep), segment.yaw, free=True)
    door = at + rng.uniform(-0.5, 0.5) * (wide - 1.2)
    canvas.box(
        segment.at(door, side * (wall - 0.1)), (rng.uniform(0.8, 1.0), 0.5), segment.yaw, free=True
    )
