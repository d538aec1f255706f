"""Mazes as in Elhafsi et al. 2020: 25 m × 25 m, with corridors 2.5 m wide."""

from __future__ import annotations

import numpy as np

from sim.canvas import Canvas

CELLS = 9
"""Number of cells along each side of the maze."""
CORRIDOR = 2.5
"""Width of a corridor [m]."""
WALL = 0.25
"""Thickness of a wall between corridors [m]."""
PITCH = CORRIDOR + WALL
"""Distance between the middles of neighbouring cells [m]."""
EDGE = 0.3
"""Width of the solid ground around the maze [m]."""
SIZE = CELLS * PITCH - WALL + 2 * EDGE
"""Side of the canvas [m]."""
LOOPS = 0.08
"""Share of the walls left by the spanning tree that are removed, so that there are loops."""

Node = tuple[int, int]


def draw_maze(rng: np.random.Generator) -> Canvas:
    """Draw a maze: a random spanning tree of the cells, with some loops."""
    canvas = Canvas(SIZE, SIZE)
    joined = _tree(rng)
    for pair in _neighbours():
        if pair not in joined and rng.random() < LOOPS:
            joined.add(pair)
    for column in range(CELLS):
        for row in range(CELLS):
            canvas.box(_middle((column, row)), (CORRIDOR, CORRIDOR), free=True)
    for start, end in sorted(joined):
        canvas.passage(_middle(start), _middle(end), CORRIDOR)
    return canvas


def _middle(node: Node) -> tuple[float, float]:
    column, row = (EDGE + 0.5 * CORRIDOR + PITCH * index for index in node)
    return column, row


def _neighbours() -> list[tuple[Node, Node]]:
    """Return the pairs of neighbouring cells, the lower one first."""
    nodes = [(column, row) for column in range(CELLS) for row in range(CELLS)]
    right = [((c, r), (c + 1, r)) for c, r in nodes if c + 1 < CELLS]
    return right + [((c, r), (c, r + 1)) for c, r in nodes if r + 1 < CELLS]


def _tree(rng: np.random.Generator) -> set[tuple[Node, Node]]:
    """Draw a spanning tree of the cells by a depth-first walk, which makes long corridors."""
    first = (int(rng.integers(CELLS)), int(rng.integers(CELLS)))
    stack, seen, joined = [first], {first}, set()
    while stack:
        column, row = here = stack[-1]
        around = [(column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)]
        new = [n for n in around if n not in seen and min(n) >= 0 and max(n) < CELLS]
        if not new:
            stack.pop()
            continue
        there = new[int(rng.integers(len(new)))]
        joined.add((min(here, there), max(here, there)))
        seen.add(there)
        stack.append(there)
    return joined
