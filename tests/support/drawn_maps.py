"""Maps of 12 m × 10 m that the tests of routes, paths and costs draw by hand."""

import math

import numpy as np

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame, OccupancyGrid
from foresee.prediction import Prediction
from planner.risk.cost_map import CostMap

CAR = CarLimits()
BODY = CAR.body
FRAME = GridFrame(0.05, (0.0, 0.0), (200, 240))
X, Y = FRAME.centres()


def grid(cells) -> OccupancyGrid:
    return OccupancyGrid.from_grid(Grid(FRAME, cells), 5.0)


def cost_of(cells, belief=None) -> CostMap:
    return CostMap.build(grid(cells), belief, BODY.half_width)


def room() -> np.ndarray:
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = (OCCUPIED,) * 4
    return cells


def divided(gap: float = 2.0) -> np.ndarray:
    """A room with a wall across it at x = 6 m that leaves a gap at the top [m]."""
    cells = room()
    cells[np.ix_((10.0 - gap) > Y, abs(X - 6.0) < 0.1)] = OCCUPIED
    return cells


def price(cost, points) -> float:
    """What a polyline (n, 2) costs a car that is nowhere slowed down."""
    return cost.along(points, np.ones(len(points)))


def clearance_of(points, cells) -> float:
    """Least distance from the points to the edge of a cell seen occupied [m]."""
    rows, cols = np.nonzero(cells == OCCUPIED)
    half = 0.5 * FRAME.resolution
    least = math.inf
    for x, y in points:
        dx = np.maximum(abs(X[cols] - x) - half, 0.0)
        dy = np.maximum(abs(Y[rows] - y) - half, 0.0)
        least = min(least, float(np.hypot(dx, dy).min()))
    return least


def prediction(p_free, p_occupied, confidence=1.0, frame=FRAME) -> Prediction:
    def all_(value):
        return np.broadcast_to(np.float32(value), frame.shape).astype(np.float32)

    return Prediction(frame, all_(p_free), all_(p_occupied), all_(confidence))
