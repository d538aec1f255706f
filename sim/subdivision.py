"""Subdivision of a rectangle into rows of rooms and the corridors between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim.spaces import Space, between


@dataclass(frozen=True)
class Layout:
    """Dimensions that the rooms and corridors of one building share.

    Attributes:
        wall: thickness of walls [m].
        corridor: width of corridors [m].
        deepest: largest depth of a row of rooms [m]; deeper rectangles are divided.
        room: mean width of the rooms in a row [m].
        halls: probability that a row of rooms is one hall.
    """

    wall: float
    corridor: float
    deepest: float
    room: float
    halls: float


def divided(space: Space, layout: Layout, rng: np.random.Generator) -> Iterator[Space]:
    """Divide a rectangle into rooms and corridors."""
    width, height = space.size
    along = 0 if width > height else 1
    if space.size[along] > 22.0 and rng.random() < 0.35:
        # Two wings, on both sides of a wall or a corridor, are laid out independently.
        yield from _halves(space, along, layout, rng)
        return
    deep = space.size[1 - along]
    if deep < layout.deepest:
        yield from row_of_rooms(space, along, layout, rng)
    elif deep < 2 * 3.0 + layout.corridor:
        yield from row_of_rooms(space, 1 - along, layout, rng)
    else:
        yield from _halves(space, 1 - along, layout, rng)


def _halves(space: Space, axis: int, layout: Layout, rng: np.random.Generator) -> Iterator[Space]:
    """Divide a rectangle by a corridor or a wall across an axis, and then both of its halves."""
    gap = layout.corridor * rng.uniform(0.8, 1.25) if rng.random() < 0.85 else 0.0
    low, high = space.low[axis], space.high[axis]
    at = low + rng.uniform(0.35, 0.65) * (high - low - gap)
    yield from divided(between(space, axis, low, at), layout, rng)
    yield from divided(between(space, axis, at + gap, high), layout, rng)
    if gap:
        yield between(space, axis, at, at + gap, corridor=True)


def row_of_rooms(
    space: Space, along: int, layout: Layout, rng: np.random.Generator
) -> Iterator[Space]:
    """Divide a rectangle into rooms side by side along an axis."""
    length = space.size[along]
    count = max(1, round(length / layout.room))
    if rng.random() < layout.halls:
        count = max(1, round(length / rng.uniform(9.0, 18.0)))
    regular = np.arange(1, count) + rng.uniform(-0.25, 0.25, count - 1) * (rng.random() < 0.5)
    cuts = space.low[along] + length * np.concatenate([[0.0], regular, [count]]) / count
    for start, end in pairwise(cuts):
        yield between(space, along, float(start), float(end))
