"""The classical predictor: it continues walls and free space along straight lines.

Most walls of a building run along two directions. From each unknown cell the predictor looks back
along these to the last observed cells: open space and its length, a wall along the line, or a wall
across it. These, and the distance to the nearest observed cells, are the inputs of two logistic
regressions, so that confidence * p_free is a probability that was fitted to drives.
"""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from foresee.mapping.kernels import njit
from foresee.mapping.straight_lines import NONE, OPEN, look_back, main_direction, nearness
from foresee.prediction import Prediction, View

MEMORY = 0.5
"""Length of open space or wall along a line that counts as full evidence [m]."""
REACH = 3.0
"""Distance over which the weight of a line falls by 1/e [m]."""
NEAR = 0.3
"""The same for evidence that is only valid at close range [m]."""
CONFIDENCE_REACH = 10.0
"""Distance over which the confidence falls by 1/e [m]."""
FREE_WEIGHTS = np.array([-1.02, 5.53, -5.09, 2.35, -5.65, -1.09, 1.68, 1.18, 8.08, -8.01])
"""Log-odds of free, fitted to drives through generated buildings: bias, then a weight for each of
the openest line, the same to the third power, the second openest line, a wall along a line, the
nearest and the second wall across, a wall along a line close by, known free space close by, a known
wall close by."""
OCCUPIED_WEIGHTS = np.array([-4.78, 1.64, -1.03, -0.74, 5.83, -1.01, 0.70, -1.41, 0.72, 1.40])
"""The same, of occupied."""


class Extend:
    """A predictor that continues walls and free space, with less confidence at greater distance."""

    context_side = 0.0

    def predict(self, view: View) -> Prediction:
        """Extend a known map along the main direction of its walls."""
        known = view.known
        resolution, cells = known.frame.resolution, known.cells
        # Without a wall, the robot's heading is the best guess of the building's direction.
        angle = main_direction(cells, default=float(view.pose[2]))
        lines = look_back(cells, angle, MEMORY / resolution)
        p_free, p_occupied, confidence = _believe(
            cells,
            *lines,
            nearness(cells, FREE, NEAR / resolution),
            nearness(cells, OCCUPIED, NEAR / resolution),
            REACH / resolution,
            NEAR / resolution,
            CONFIDENCE_REACH / resolution,
            FREE_WEIGHTS,
            OCCUPIED_WEIGHTS,
        )
        return Prediction(known.frame, p_free, p_occupied, confidence)


@njit(cache=True, nogil=True)
def _believe(  # type: ignore[no-untyped-def]
    cells, kind, distance, support, near_free, near_wall, reach, near, trust, free, occupied
):
    """Return p_free, p_occupied and confidence, each (rows, columns)."""
    rows, cols = cells.shape
    out = np.zeros((3, rows, cols), dtype=np.float32)
    x = np.ones(10)
    for row in range(rows):
        for col in range(cols):
            if cells[row, col] != UNKNOWN:
                out[0, row, col] = 1.0 if cells[row, col] == FREE else 0.0
                out[1, row, col] = 1.0 - out[0, row, col]
                out[2, row, col] = 1.0
                continue
            x[1:8] = 0.0
            closest = math.inf
            for line in range(4):
                if kind[line, row, col] == NONE:
                    continue
                gap, strength = distance[line, row, col], support[line, row, col]
                weight = math.exp(-gap / reach)
                closest = min(closest, gap)
                if kind[line, row, col] == OPEN:
                    x[1], x[3] = _two_largest(x[1], x[3], strength * weight)
                else:
                    x[4] = max(x[4], strength * weight)
                    x[5], x[6] = _two_largest(x[5], x[6], (1.0 - strength) * weight)
                    x[7] = max(x[7], strength * math.exp(-gap / near))
            if closest == math.inf:
                continue
            confidence = math.exp(-closest / trust)
            x[2] = x[1] ** 3
            x[8], x[9] = near_free[row, col], near_wall[row, col]
            # The regressions were fitted to the product with the confidence.
            a = min(1.0 / (1.0 + math.exp(-np.dot(free, x))), confidence)
            b = min(1.0 / (1.0 + math.exp(-np.dot(occupied, x))), confidence - a)
            out[0, row, col] = a / confidence
            out[1, row, col] = b / confidence
            out[2, row, col] = confidence
    return out[0], out[1], out[2]


@njit(cache=True, nogil=True, inline="always")
def _two_largest(first, second, value):  # type: ignore[no-untyped-def]
    if value > first:
        return value, first
    return first, max(second, value)
