"""Corridors around blocks of solid ground; unlike the branches of a network, they form loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sim.canvas import Canvas, Point

WIDTH = (3.5, 10.0)
"""Narrowest and widest path [m], as in Katyal et al. 2018."""
GAP = 2.5
"""Least solid ground between parallel paths [m]."""
PITCH = WIDTH[1] + GAP + 5.0
"""Distance between parallel paths that the canvas has room for [m], enough for every draw."""
COLUMNS, ROWS = 4, 3
"""Number of columns and of rows of crossings."""
LOOPS = 0.55
"""Share of the possible paths closing a loop that are carved."""
ASKEW = 0.25
"""Share of the crossings that are shifted off their lines, so that their paths run at an angle."""

Node = tuple[int, int]


def draw_paper(rng: np.random.Generator) -> Canvas:
    """Draw paths that join crossings.

    Every crossing can be reached from every other; most can be reached from two sides.
    """
    canvas = Canvas(PITCH * COLUMNS + 2.0, PITCH * ROWS + 2.0)
    xs, column_widths = _lines(COLUMNS, rng)
    ys, row_widths = _lines(ROWS, rng)
    at: dict[Node, Point] = {}
    askew: set[Node] = set()
    for column in range(COLUMNS):
        for row in range(ROWS):
            shift = (0.0, 0.0)
            if rng.random() < ASKEW:
                askew.add((column, row))
                shift = (rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2))
            at[column, row] = (xs[column] + shift[0], ys[row] + shift[1])
    for start, end in _joined(rng):
        # A path is as wide as its line, or narrower, so that no wall stands in a crossing.
        line = row_widths[start[1]] if start[1] == end[1] else column_widths[start[0]]
        width = line if rng.random() < 0.6 else rng.uniform(WIDTH[0], line)
        canvas.passage(at[start], at[end], width)
        for node in (start, end):
            if node in askew:
                canvas.disc(at[node], 0.5 * width, free=True)
            else:
                canvas.box(at[node], (width, width), free=True)
    return canvas


def _lines(count: int, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Draw parallel lines of paths: return the coordinate and the width of each [m]."""
    widths = rng.uniform(*WIDTH, count)
    middles = [1.0 + 0.5 * widths[0] + 1.2]
    for before, after in pairwise(widths):
        solid = rng.uniform(GAP + 2.4, 7.4)
        middles.append(middles[-1] + 0.5 * (before + after) + solid)
    return [float(middle) for middle in middles], [float(width) for width in widths]


def _joined(rng: np.random.Generator) -> list[tuple[Node, Node]]:
    """Draw which neighbouring crossings a path joins: a spanning tree, and some other pairs."""
    nodes = [(column, row) for column in range(COLUMNS) for row in range(ROWS)]
    pairs = [
        ((column, row), neighbour)
        for column, row in nodes
        for neighbour in ((column + 1, row), (column, row + 1))
        if neighbour in nodes
    ]
    group = {node: number for number, node in enumerate(nodes)}
    joined = []
    for index in rng.permutation(len(pairs)):
        node, neighbour = pairs[index]
        kept, merged = group[node], group[neighbour]
        if kept == merged and rng.random() >= LOOPS:
            continue
        joined.append((node, neighbour))
        group = {node: kept if g == merged else g for node, g in group.items()}
    return joined
