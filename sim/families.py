"""Families of generated buildings; the same family and seed give the same world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.family_names import FAMILIES
from sim.blocks import block_size, draw_blocks
from sim.canvas import Canvas
from sim.corridor_network import NetworkConfig, Segment, carve, grow
from sim.floor_plan import draw_floor_plan
from sim.maze import draw_maze
from sim.obstacle_field import draw_obstacle_field
from sim.office import draw_office
from sim.world import World

CORRIDOR = NetworkConfig(62.0, (3.5, 10.0), (9.0, 22.0), 14, oblique=0.35, reach=45.0)
NARROW = NetworkConfig(46.0, (1.5, 3.0), (5.0, 13.0), 22, oblique=0.1, gap=1.2, reach=45.0)
TRAP = NetworkConfig(60.0, (2.4, 4.5), (8.0, 16.0), 16, oblique=0.15, gap=1.0, reach=50.0)
"""Settings of the networks of the families `corridor`, `narrow` and `trap`."""

PASSAGE = 1.5
"""Width that an obstacle in a building of `trap` leaves open beside it [m]."""


def generate(family: str, seed: int) -> World:
    """Generate a building of a family.

    - `corridor`: a network of corridors 3.5–10 m wide, the widths of Katyal et al. 2018.
    - `narrow`: corridors of 1.5–3 m, door frames across them, small rooms behind doors.
    - `office`: rooms off corridors, doors, furniture.
    - `trap`: an obstacle just behind a blind corner; dead ends that look like a corridor going on.
    - `floor_plan`: rooms wall to wall, corridors and halls, as in real buildings.
    - `paper`: paths of 3.5–10 m around blocks, with loops, as in the data of Katyal et al. 2018.
    - `maze`: corridors of 2.5 m on 25 m × 25 m, as in Elhafsi et al. 2020.
    - `obstacle_field`: an open field full of obstacles, as in BARN (Perille et al. 2020).

    Raises:
        ValueError: if there is no such family.
    """
    draw = {
        "corridor": _corridor,
        "narrow": _narrow,
        "office": _office,
        "trap": _trap,
        "paper": _paper,
        "floor_plan": draw_floor_plan,
        "maze": draw_maze,
        "obstacle_field": draw_obstacle_field,
    }
    if family not in draw:
        raise ValueError(f"family is {family!r}, it must be one of {', '.join(FAMILIES)}")
    # The family is part of the seed, so that equal seeds do not give equal networks.
    rng = np.random.default_rng([FAMILIES.index(family), seed])
    return draw[family](rng).world(f"{family}-{seed}")


def empty_straight(length: float = 60.0, width: float = 4.0) -> World:
    """Return a building of one straight corridor of a length and width [m], closed at both ends."""
    canvas = Canvas(length + 1.0, width + 1.0)
    canvas.room((0.5, 0.5), (0.5 + length, 0.5 + width))
    return canvas.world(f"straight-{length:g}x{width:g}")


def _network(config: NetworkConfig, rng: np.random.Generator) -> tuple[Canvas, list[Segment]]:
    canvas, segments = Canvas(config.size, config.size), grow(config, rng)
    carve(canvas, segments)
    return canvas, segments


def _corridor(rng: np.random.Generator) -> Canvas:
    return _network(CORRIDOR, rng)[0]


def _paper(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(*block_size())
    draw_blocks(canvas, rng)
    return canvas


def _office(rng: np.random.Generator) -> Canvas:
    size = (rng.uniform(36.0, 52.0), rng.uniform(24.0, 36.0))
    canvas = Canvas(size[0] + 1.0, size[1] + 1.0)
    draw_office(canvas, size, rng)
    return canvas


def _narrow(rng: np.random.Generator) -> Canvas:
    canvas, segments = _network(NARROW, rng)
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
    if not _is_solid(canvas, NARROW, segment, along, across):
        return
    canvas.box(segment.at(at, side * (wall + 0.5 * deep)), (wide, deep), segment.yaw, free=True)
    door = at + rng.uniform(-0.5, 0.5) * (wide - 1.2)
    canvas.box(
        segment.at(door, side * (wall - 0.1)), (rng.uniform(0.8, 1.0), 0.5), segment.yaw, free=True
    )


def _is_solid(
    canvas: Canvas,
    config: NetworkConfig,
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


def _trap(rng: np.random.Generator) -> Canvas:
    canvas, segments = _network(TRAP, rng)
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
    if not _is_solid(canvas, TRAP, segment, along, across):
        return
    middle = segment.at(at, side * (wall + 0.5 * depth - 0.1))
    canvas.box(middle, (width, depth + 0.2), segment.yaw, free=True)
