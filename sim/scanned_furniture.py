"""Furniture as a LIDAR sees it near the floor: legs of tables and chairs, and solid bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.canvas import Canvas
from sim.office import Room, at_wall, furnish, put
from sim.turned_canvas import rotated

CHAIR = 0.42
"""Distance between the legs of a chair [m]."""
SOLID = {
    "shelf": ((0.8, 2.4), (0.3, 0.45)),
    "cupboard": ((0.6, 1.2), (0.5, 0.65)),
    "sofa": ((1.4, 2.2), (0.8, 0.95)),
    "bed": ((1.9, 2.1), (0.85, 1.6)),
    "box": ((0.3, 0.6), (0.3, 0.5)),
}
"""Furniture that reaches down to the floor: its length, and its depth [m]."""


def furnish_as_scanned(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put furniture into a room: rows of desks, a table, things along the walls."""
    if min(room.high[0] - room.low[0], room.high[1] - room.low[1]) < 2.0:
        return
    kind = rng.random()
    if kind < 0.15:
        furnish(canvas, room, rng)
        return
    if kind < 0.55:
        _rows_of_desks(canvas, room, rng)
    elif kind < 0.9:
        _table(canvas, room, rng)
    for name in rng.choice(list(SOLID), int(rng.integers(1, 5))):
        length, depth = SOLID[str(name)]
        put(canvas, room, at_wall(room, (rng.uniform(*length), rng.uniform(*depth)), rng))


def _rows_of_desks(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put desks in rows, as in a classroom or an open-plan office, each with a chair."""
    desk = np.array([rng.uniform(1.1, 1.7), rng.uniform(0.6, 0.8)])
    pitch = desk + np.array([rng.choice([0.1, 0.9]), rng.uniform(0.9, 1.4)])
    axis = int(rng.integers(2))
    low, high = np.array(room.low)[[axis, 1 - axis]] + 1.0, np.array(room.high)[[axis, 1 - axis]]
    grids = [np.arange(low[i] + 0.5 * desk[i], high[i] - 1.0, pitch[i]) for i in (0, 1)]
    places = np.stack(np.meshgrid(*grids), axis=-1).reshape(-1, 2)
    places = places[rng.random(len(places)) < rng.uniform(0.6, 1.0)]
    aside = np.array([0.0, 0.5 * desk[1] + 0.25])
    chairs = places + aside + rng.uniform(-0.15, 0.15, places.shape)
    legs = np.concatenate([_legs(places, desk), _legs(chairs, np.full(2, CHAIR), rng)])
    canvas.posts(_off_the_door(legs[:, [axis, 1 - axis]], room))


def _table(canvas: Canvas, room: Room, rng: np.random.Generator) -> None:
    """Put a table into the middle of a room, with chairs around it."""
    size = np.array([rng.uniform(0.8, 2.4), rng.uniform(0.7, 1.1)])
    along = np.arange(-0.5 * size[0] + 0.3, 0.5 * size[0], 0.7)
    aside = 0.5 * size[1] + 0.25
    chairs = np.concatenate([np.stack([along, np.full(len(along), y)], 1) for y in (aside, -aside)])
    chairs = chairs[rng.random(len(chairs)) < 0.8] + rng.uniform(-0.1, 0.1)
    middle = np.array(room.middle) + rng.uniform(-0.5, 0.5, 2)
    legs = np.concatenate([_legs(np.zeros((1, 2)), size), _legs(chairs, np.full(2, CHAIR), rng)])
    canvas.posts(_off_the_door(middle + rotated(legs, rng.choice([0.0, 0.5 * np.pi])), room))


def _legs(
    places: NDArray[np.float64], size: NDArray[np.float64], rng: np.random.Generator | None = None
) -> NDArray[np.float64]:
    """Return the four legs of each piece of furniture (n, 2), turned at random with `rng`."""
    corners = 0.5 * size * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    yaws = rng.uniform(-0.4, 0.4, len(places)) if rng else np.zeros(len(places))
    cos, sin = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x = cos * corners[:, 0] - sin * corners[:, 1]
    y = sin * corners[:, 0] + cos * corners[:, 1]
    return (places[:, None, :] + np.stack([x, y], axis=-1)).reshape(-1, 2)


def _off_the_door(points: NDArray[np.float64], room: Room) -> NDArray[np.float64]:
    return points[np.hypot(*(points - room.door).T) > 1.0]
