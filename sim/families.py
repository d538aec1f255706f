"""Families of generated buildings; the same family and seed give the same world."""

from __future__ import annotations

import numpy as np

from foresee.infra.float_errors import usual_float_errors
from foresee.mapping.family_names import FAMILIES
from sim.as_built import draw_as_built
from sim.canvas import Canvas
from sim.corridor_network import draw_corridor
from sim.floor_plan import draw_floor_plan
from sim.maze import draw_maze
from sim.narrow import draw_narrow
from sim.obstacle_field import draw_obstacle_field
from sim.office import draw_office
from sim.paper import draw_paper
from sim.trap import draw_trap
from sim.world import World


@usual_float_errors()
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
    - `as_built`: buildings as they are, in architects' plans and in maps that robots make.

    Raises:
        ValueError: if there is no such family.
    """
    draw = {
        "corridor": draw_corridor,
        "narrow": draw_narrow,
        "office": draw_office,
        "trap": draw_trap,
        "paper": draw_paper,
        "floor_plan": draw_floor_plan,
        "maze": draw_maze,
        "obstacle_field": draw_obstacle_field,
        "as_built": draw_as_built,
    }
    if family not in draw:
        raise ValueError(f"family is {family!r}, it must be one of {', '.join(FAMILIES)}")
    # The family is part of the seed, so that equal seeds do not give equal networks.
    rng = np.random.default_rng([FAMILIES.index(family), seed])
    return draw[family](rng).world(f"{family}-{seed}")


def empty_straight(length: float, width: float) -> World:
    """Return a building of one straight corridor of a length and width [m], closed at both ends."""
    canvas = Canvas(length + 1.0, width + 1.0)
    canvas.room((0.5, 0.5), (0.5 + length, 0.5 + width))
    return canvas.world(f"straight-{length:g}x{width:g}")
