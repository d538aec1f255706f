"""Fields of obstacles as in BARN, from a cellular automaton (Perille et al. 2020).

BARN's cells of 0.15 m are made for a robot that turns on the spot. Here they are scaled to a car
that turns with a radius of 0.8 m.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve, label

from sim.canvas import Canvas

ROWS, COLUMNS = 30, 60
"""Number of cells across the field, and along it."""
PITCH = 0.45
"""Side of a cell [m]."""
FILLED = (0.15, 0.2, 0.25, 0.3)
"""Possible shares of cells that are filled at first; one is drawn, as in BARN."""
STEPS = (2, 3, 4)
"""Possible numbers of steps of the automaton; one is drawn, as in BARN."""
FILL, CLEAR = 5, 1
"""Numbers of filled neighbours, of 8: a cell with at least the first number is filled, and one with
at most the second is cleared."""
EDGE = 0.5
"""Width of the solid ground around the field [m]."""
END = 2.5
"""Length of the free ground at both ends, for start and goal [m]."""
NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])
"""Kernel that counts the eight neighbours of a cell."""


def draw_obstacle_field(rng: np.random.Generator) -> Canvas:
    """Draw a field of obstacles with free ground at both ends."""
    share, steps = float(rng.choice(FILLED)), int(rng.choice(STEPS))
    filled = rng.random((ROWS, COLUMNS)) < share
    for _ in range(steps):
        around = convolve(filled.astype(np.int8), NEIGHBOURS, mode="constant")
        filled = (filled | (around >= FILL)) & (around > CLEAR)
    filled = _reachable(filled)
    length, width = COLUMNS * PITCH, ROWS * PITCH
    canvas = Canvas(length + 2 * (END + EDGE), width + 2 * EDGE)
    canvas.room((EDGE, EDGE), (EDGE + length + 2 * END, EDGE + width))
    for row, column in np.argwhere(filled):
        middle = (EDGE + END + PITCH * (column + 0.5), EDGE + PITCH * (row + 0.5))
        canvas.box(middle, (PITCH, PITCH))
    return canvas


def _reachable(filled: np.typing.NDArray[np.bool_]) -> np.typing.NDArray[np.bool_]:
    """Return the filled cells, and with them all that cannot be reached from the field's ends."""
    free = np.pad(~filled, ((0, 0), (1, 1)), constant_values=True)
    pieces, _ = label(free)
    kept = (pieces == pieces[0, 0]) | (pieces == pieces[0, -1])
    return ~kept[:, 1:-1]
