"""The context of a prediction: a coarse map of all that was observed around the predicted square.

It lets a predictor know what kind of building it is in, and what lies beyond the square.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import FREE, OCCUPIED, Grid
from foresee.mapping.kernels import njit

SIDE = 40.0
"""Side of the context [m]."""
CELL = 0.5
"""Side of a cell of the context [m]."""
CELLS = round(SIDE / CELL)
"""Side of the context [cells]."""


def coarse_context(around: Grid) -> NDArray[np.uint8]:
    """Return the percentage of each coarse cell that was observed free, and observed occupied.

    Args:
        around: map of all that was observed in a square of `SIDE` around the robot.

    Returns:
        Percentages (2, CELLS, CELLS).

    Raises:
        ValueError: if the map is not of this size.
    """
    rows, cols = around.frame.shape
    fine = CELL / around.frame.resolution
    if min(rows, cols) < CELLS or max(abs(rows - CELLS * fine), abs(cols - CELLS * fine)) > 2:
        raise ValueError(f"the map is of {around.frame.size} m, it must be of {SIDE} x {SIDE} m")
    starts = np.rint(np.arange(CELLS + 1) * fine).astype(np.int64)
    starts[-1] = min(rows, cols)
    return _percentages(around.cells, starts)


@njit(cache=True, nogil=True)
def _percentages(cells, starts):  # type: ignore[no-untyped-def]
    """Return the percentages of free and of occupied cells in each coarse cell.

    `starts` holds the first row (or column) of each coarse cell, and the end of the last one.
    """
    count = len(starts) - 1
    out = np.zeros((2, count, count), dtype=np.uint8)
    # Whole rows are added first, which compiles to vector code.
    sums = np.zeros((2, starts[-1]), dtype=np.int32)
    for row in range(count):
        sums[:] = 0
        for i in range(starts[row], starts[row + 1]):
            for j in range(starts[-1]):
                sums[0, j] += cells[i, j] == FREE
                sums[1, j] += cells[i, j] == OCCUPIED
        for col in range(count):
            first, end = starts[col], starts[col + 1]
            area = (starts[row + 1] - starts[row]) * (end - first)
            for kind in range(2):
                if area > 0:
                    out[kind, row, col] = round(100 * sums[kind, first:end].sum() / area)
    return out
