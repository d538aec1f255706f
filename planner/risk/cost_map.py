"""The cost map: the cost of each metre of a route, for the search for a route to the goal.

A route may cross unobserved space at a higher cost, which a prediction changes. The cost map has no
influence on safety: the risk map decides which cells a plan may enter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame, OccupancyGrid, paste
from foresee.prediction import Prediction
from planner.risk.distance_transform import distance_field

UNKNOWN_COST = 1.4
"""Cost of a metre of unobserved space, in metres of free space."""
OCCUPIED_COST = 20.0
"""Cost of a metre of space that is predicted to be occupied, in metres of free space."""
WALL_PRIOR, WALL_REACH = 15.0, 2.5
"""Additional cost of a metre of unobserved space right beside an occupied cell, and distance from
the cell at which it has fallen to 0 [m]. Walls usually continue, so that a route should turn off
where an opening was observed."""
STUCK_REACH = 1.2
"""Distance from a place where the car got stuck up to which unobserved cells cost as much as
walls [m]."""
PREDICTED_WALL = 8.0
"""Cost of a metre above which an unobserved cell counts as predicted occupied."""


@dataclass(frozen=True, eq=False)
class CostMap:
    """Cost of a metre of route in each cell, on cells of about 0.1 m.

    Attributes:
        frame: position and resolution of the cells.
        density: cost of a metre [1], (rows, columns).
        clearance: distance to the nearest cell observed occupied [m], (rows, columns).
        room: distance to the nearest cell observed or predicted occupied [m], (rows, columns).
        unseen: cells that hold an unobserved cell of the map, (rows, columns).
        unsure: cells that are neither observed nor predicted free; on a prescribed route, which is
            more reliable than any prediction, all unobserved cells, (rows, columns).
        required: clearance below which the car's body does not fit [m].
    """

    frame: GridFrame
    density: NDArray[np.float32]
    clearance: NDArray[np.float32]
    room: NDArray[np.float32]
    unseen: NDArray[np.bool_]
    unsure: NDArray[np.bool_]
    required: float

    @classmethod
    def build(
        cls,
        known: OccupancyGrid,
        remembered: RememberedCost | None,
        half_width: float,
        prescribed: NDArray[np.float64] | None = None,
        stuck: NDArray[np.float64] | None = None,
    ) -> CostMap:
        """Build a cost map from the observed map and the remembered predictions.

        Args:
            known: map of all that was observed.
            remembered: cost according to the predictions so far; None: without predictions.
            half_width: half the width of the car's body [m].
            prescribed: points (n, 2) [m] of a prescribed route, less than a cell apart, or None.
                Its unobserved cells cost as much as free ones, and those beside it as much as
                predicted walls: the car leaves the route only where it must, not for a short cut.
            stuck: points (k, 2) [m] at which the car got stuck, or None. The unobserved cells
                around them cost as much as predicted walls.
        """
        frame = coarsened(known.frame)
        occupied, unseen = _pooled(known, frame)
        clearance = distance_field(occupied) * np.float32(frame.resolution)
        unknown = UNKNOWN_COST if prescribed is None else OCCUPIED_COST
        prior = np.float32(WALL_PRIOR) * np.clip(1.0 - clearance / WALL_REACH, 0.0, None)
        density = np.where(unseen, np.float32(unknown) + prior, np.float32(1.0))
        room, unsure = clearance, unseen
        if remembered is not None:
            predicted_cost = remembered.on(frame)
            steered = unseen & np.isfinite(predicted_cost)
            walls = steered & (predicted_cost > PREDICTED_WALL)
            room = distance_field(occupied | walls) * np.float32(frame.resolution)
            if prescribed is None:
                unsure = unseen & ~(steered & (predicted_cost < 0.5 * (1.0 + UNKNOWN_COST)))
                # The prior of continued walls fades where the prediction says free.
                doubt = np.clip(predicted_cost - 1.0, 0.0, 1.0)
                density[steered] = (predicted_cost + prior * doubt)[steered]
        if prescribed is not None:
            density[_beside(prescribed, frame)] = 1.0
        for x, y in () if stuck is None else stuck:
            here = around(frame, float(x), float(y), STUCK_REACH)
            density[here][unseen[here]] = OCCUPIED_COST
        # Routes keep away from walls, up to a clearance of 0.7 m for a body of 0.3 m.
        comfort = half_width + 0.55
        density += np.float32(2.0) * np.clip(1.0 - clearance / comfort, 0.0, None)
        return cls(
            frame, density.astype(np.float32), clearance, room, unseen, unsure, half_width + 0.12
        )

    def along(self, points: NDArray[np.float64], slowness: NDArray[np.float64]) -> float:
        """Return the cost of a polyline; outside the map a metre costs `UNKNOWN_COST`.

        Args:
            points: points of the polyline, (n, 2) [m].
            slowness: top speed divided by the speed at each point, (n,).
        """
        inside, rows, cols = self.frame.locate(points)
        price = np.full(len(points), UNKNOWN_COST)
        fits = self.clearance[rows, cols] >= self.required
        price[inside] = np.where(fits, self.density[rows, cols], OCCUPIED_COST)
        steps = np.hypot(*np.diff(points, axis=0).T)
        return float((steps * (price * slowness)[1:]).sum())


def _pooled(known: OccupancyGrid, frame: GridFrame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the coarse cells that hold an occupied cell, and those that hold an unobserved one."""
    factor = coarsening(known.frame)
    rows, cols = frame.shape
    log_odds = np.zeros((rows * factor, cols * factor), dtype=np.int8)
    log_odds[: known.frame.shape[0], : known.frame.shape[1]] = known.log_odds
    worst = log_odds[::factor, ::factor].copy()
    unseen = worst == 0
    for i in range(factor):
        for j in range(factor):
            part = log_odds[i::factor, j::factor]
            np.maximum(worst, part, out=worst)
            unseen |= part == 0
    return worst > 0, unseen


def _beside(
    prescribed: NDArray[np.float64], frame: GridFrame
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the cells within two cells of the points (n, 2) [m] of a route."""
    near = np.arange(-2, 3)
    cells = np.floor((prescribed - np.array(frame.origin)) / frame.resolution).astype(int)
    rows = (cells[:, 1, None, None] + near[:, None]).clip(0, frame.shape[0] - 1)
    cols = (cells[:, 0, None, None] + near).clip(0, frame.shape[1] - 1)
    return rows, cols


def around(frame: GridFrame, x: float, y: float, reach: float) -> tuple[slice, slice]:
    """Return the square of cells within reach of a point [m], cut at the frame's edges."""
    row, col = frame.cell(x, y)
    n = round(reach / frame.resolution)
    return np.s_[max(0, row - n) : row + n + 1, max(0, col - n) : col + n + 1]


@dataclass(frozen=True, eq=False)
class RememberedCost:
    """The cost of a metre in each cell according to the cell's newest prediction.

    Predictions are remembered, since a car that forgot a predicted dead end as soon as it turned
    away from it would turn round again and again.

    Attributes:
        frame: position and resolution of the cells, those of a cost map.
        density: cost of a metre [1], NaN where nothing was predicted, (rows, columns).
    """

    frame: GridFrame
    density: NDArray[np.float32]

    def on(self, frame: GridFrame) -> NDArray[np.float32]:
        """Return the density on another frame of the same lattice."""
        if frame == self.frame:
            return self.density
        return paste(self.frame, self.density, frame, np.float32(np.nan))


def coarsening(frame: GridFrame) -> int:
    """Return the number of cells of a map, along each axis, that make one cell of its cost map."""
    return max(1, round(0.1 / frame.resolution))


def coarsened(frame: GridFrame) -> GridFrame:
    """Return the frame of a map's cost map."""
    factor = coarsening(frame)
    rows, cols = (-(-n // factor) for n in frame.shape)
    return GridFrame(frame.resolution * factor, frame.origin, (rows, cols))


def remember(
    remembered: RememberedCost | None, frame: GridFrame, prediction: Prediction
) -> RememberedCost:
    """Return the remembered cost with a new prediction added.

    A cell that is predicted with confidence 0 costs as much as unobserved space.

    Args:
        remembered: cost according to the predictions so far, or None.
        frame: frame of the observed map.
        prediction: new prediction, on the same lattice.
    """
    coarse, factor = coarsened(frame), coarsening(frame)
    density = (
        np.full(coarse.shape, np.nan, dtype=np.float32)
        if remembered is None
        else remembered.on(coarse).copy()
    )
    row, col = frame.offset(prediction.frame)
    confidence = prediction.confidence
    predicted_cost = (
        UNKNOWN_COST
        + (1.0 - UNKNOWN_COST) * confidence * prediction.p_free
        + (OCCUPIED_COST - UNKNOWN_COST) * confidence * prediction.p_occupied
    )
    rows = (row + np.arange(predicted_cost.shape[0])) // factor
    cols = (col + np.arange(predicted_cost.shape[1])) // factor
    keep_r = (rows >= 0) & (rows < density.shape[0])
    keep_c = (cols >= 0) & (cols < density.shape[1])
    predicted_cost, rows, cols = predicted_cost[np.ix_(keep_r, keep_c)], rows[keep_r], cols[keep_c]
    if predicted_cost.size:
        top, left = rows[0], cols[0]
        shape = (int(rows[-1] - top + 1), int(cols[-1] - left + 1))
        flat = ((rows - top)[:, None] * shape[1] + (cols - left)[None, :]).ravel()
        total = np.bincount(flat, predicted_cost.ravel(), shape[0] * shape[1]).reshape(shape)
        count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
        density[top : top + shape[0], left : left + shape[1]] = total / count
    return RememberedCost(coarse, density)
