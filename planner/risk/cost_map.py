"""The cost map: the cost of each metre of a route, for the search for a route to the goal.

A route may cross unobserved space at a higher cost, which a prediction changes. The cost map has no
influence on safety: the risk map decides which cells a plan may enter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from foresee.mapping.grid import GridFrame, OccupancyGrid, paste
from foresee.prediction import Prediction
from planner.risk.distance_transform import distance_field

UNKNOWN_COST = 1.4
"""Cost of a metre of unobserved space, in metres of free space."""
AVOIDED_COST = 20.0
"""Cost of a metre of unobserved space that the car should enter only if nothing else is left: near
a place where it got stuck, and beside a prescribed route."""
WAY_BACK, LANES = 30.0, 6
"""Expected cost of a predicted obstacle, see `blocked_cost`: the way to it and back again [m], and
how many lanes lie side by side in an opening."""
WALL_PRIOR, WALL_REACH = 15.0, 2.5
"""Additional cost of a metre of unobserved space right beside an occupied cell, and distance from
the cell at which it has fallen to 0 [m]. Walls usually continue, so that a route should turn off
where an opening was observed."""
STUCK_REACH = 1.2
"""Distance from a place where the car got stuck up to which unobserved cells cost as much as
walls [m]."""
SURE = 0.65
"""Trust of a cell from which on it costs no more than free space."""
LIKELY = 0.5
"""Probability above which an unobserved cell counts as predicted free, or as predicted blocked."""


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
        belief: Belief | None,
        half_width: float,
        prescribed: NDArray[np.float64] | None = None,
        stuck: NDArray[np.float64] | None = None,
    ) -> CostMap:
        """Build a cost map from the observed map and the remembered predictions.

        Args:
            known: map of all that was observed.
            belief: what was predicted so far; None: without predictions.
            half_width: half the width of the car's body [m].
            prescribed: points (n, 2) [m] of a prescribed route, less than a cell apart, or None.
                Its unobserved cells cost as much as free ones, and those beside it
                `AVOIDED_COST`: the car leaves the route only where it must, not for a short cut.
            stuck: points (k, 2) [m] at which the car got stuck, or None. The unobserved cells
                around them cost `AVOIDED_COST`.
        """
        frame = coarsened(known.frame)
        required = half_width + 0.12
        occupied, unseen = _pooled(known, frame)
        clearance = distance_field(occupied) * np.float32(frame.resolution)
        unknown = UNKNOWN_COST if prescribed is None else AVOIDED_COST
        prior = np.float32(WALL_PRIOR) * np.clip(1.0 - clearance / WALL_REACH, 0.0, None)
        density = np.where(unseen, np.float32(unknown) + prior, np.float32(1.0))
        room, unsure = clearance, unseen
        if belief is not None:
            free, blocked = belief.on(frame)
            predicted = unseen & np.isfinite(free)
            blocked = np.where(predicted, blocked, np.float32(0.0))
            room = distance_field(occupied | (blocked > LIKELY)) * np.float32(frame.resolution)
            if prescribed is None:
                unsure = unseen & ~(predicted & (free > LIKELY))
                # The prior of continued walls fades where free space is predicted.
                doubt = 1.0 - np.clip(free / SURE, 0.0, 1.0)
                unsure_cost = 1.0 + (np.float32(UNKNOWN_COST - 1.0) + prior) * doubt
                density[predicted] = unsure_cost[predicted]
                # As close to a predicted obstacle as to an observed one, the body does not fit.
                # At least one cell on each side, or the route search would see gaps in thin walls.
                reach = max(1, math.ceil(required / frame.resolution) - 1)
                near = maximum_filter(blocked, size=1 + 2 * reach)
                density += blocked_cost(near, 2 * reach * frame.resolution)
        if prescribed is not None:
            density[_beside(prescribed, frame)] = 1.0
        for x, y in () if stuck is None else stuck:
            here = around(frame, float(x), float(y), STUCK_REACH)
            density[here][unseen[here]] = AVOIDED_COST
        # Routes keep away from walls, up to a clearance of 0.7 m for a body of 0.3 m.
        comfort = half_width + 0.55
        density += np.float32(2.0) * np.clip(1.0 - clearance / comfort, 0.0, None)
        return cls(frame, density.astype(np.float32), clearance, room, unseen, unsure, required)

    def along(self, points: NDArray[np.float64], slowness: NDArray[np.float64]) -> float:
        """Return the cost of a polyline; outside the map a metre costs `UNKNOWN_COST`.

        Args:
            points: points of the polyline, (n, 2) [m].
            slowness: top speed divided by the speed at each point, (n,).
        """
        inside, rows, cols = self.frame.locate(points)
        price = np.full(len(points), UNKNOWN_COST)
        fits = self.clearance[rows, cols] >= self.required
        price[inside] = np.where(fits, self.density[rows, cols], AVOIDED_COST)
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


def blocked_cost(blocked: NDArray[np.float32], thickness: float) -> NDArray[np.float32]:
    """Return the additional cost of a metre in cells that are blocked with a probability.

    Where a route is blocked, the car has to come back, and try another one: `WAY_BACK` metres. But
    it is blocked only if all lanes of the opening are; of `LANES` independent ones that is the
    probability to the power of `LANES`. So a doubt costs little, however far it extends, and a sure
    wall costs `WAY_BACK`, even if it is thin.

    Args:
        blocked: probability that a cell is not free, (rows, columns).
        thickness: how thick the thinnest wall is to the route search [m].
    """
    return np.float32(WAY_BACK / thickness) * blocked**LANES


@dataclass(frozen=True, eq=False)
class Belief:
    """The newest prediction of each cell, on the coarser cells of a cost map.

    Predictions are remembered, since a car that forgot a predicted dead end as soon as it turned
    away from it would turn round again and again.

    Attributes:
        frame: position and resolution of the cells, those of a cost map.
        free: mean trust, confidence · p_free, NaN where nothing was predicted, (rows, columns).
        blocked: largest probability of a cell that it is not free, at most the confidence, NaN
            where nothing was predicted, (rows, columns).
    """

    frame: GridFrame
    free: NDArray[np.float32]
    blocked: NDArray[np.float32]

    def on(self, frame: GridFrame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return `free` and `blocked` on another frame of the same lattice."""
        if frame == self.frame:
            return self.free, self.blocked
        nan = np.float32(np.nan)
        return paste(self.frame, self.free, frame, nan), paste(self.frame, self.blocked, frame, nan)


def coarsening(frame: GridFrame) -> int:
    """Return the number of cells of a map, along each axis, that make one cell of its cost map."""
    return max(1, round(0.1 / frame.resolution))


def coarsened(frame: GridFrame) -> GridFrame:
    """Return the frame of a map's cost map."""
    factor = coarsening(frame)
    rows, cols = (-(-n // factor) for n in frame.shape)
    return GridFrame(frame.resolution * factor, frame.origin, (rows, cols))


def remember(belief: Belief | None, frame: GridFrame, prediction: Prediction) -> Belief:
    """Return the belief with a new prediction added.

    A cell that is predicted with confidence 0 costs as much as unobserved space.

    Args:
        belief: what was predicted so far, or None.
        frame: frame of the observed map.
        prediction: new prediction, on the same lattice.
    """
    grown, factor = _on_map(belief, frame), coarsening(frame)
    row, col = frame.offset(prediction.frame)
    rows, inside_rows = _coarse_index(row, prediction.frame.shape[0], factor, grown.frame.shape[0])
    cols, inside_cols = _coarse_index(col, prediction.frame.shape[1], factor, grown.frame.shape[1])
    if len(rows) and len(cols):
        here = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        p_free, confidence = (
            values[inside_rows, inside_cols]
            for values in (prediction.p_free, prediction.confidence)
        )
        counts = _joined(np.ones(p_free.shape, np.float32), rows, cols, np.add)
        grown.free[here] = _joined(confidence * p_free, rows, cols, np.add) / counts
        not_free = np.minimum(1.0 - p_free, confidence)
        grown.blocked[here] = _joined(not_free, rows, cols, np.maximum)
    return grown


def _on_map(belief: Belief | None, frame: GridFrame) -> Belief:
    """Return a copy of a belief on the cost map of a map's frame; None: nothing was predicted."""
    coarse = coarsened(frame)
    if belief is None:
        return Belief(coarse, *np.full((2, *coarse.shape), np.nan, dtype=np.float32))
    return Belief(coarse, *(values.copy() for values in belief.on(coarse)))


def _coarse_index(
    first: int, count: int, factor: int, length: int
) -> tuple[NDArray[np.int64], slice]:
    """Return the coarse index of each of some rows or columns, and the slice of those inside.

    Args:
        first: index of the first of them.
        count: number of them.
        factor: number of them that make a coarse one.
        length: number of coarse ones.
    """
    low, high = max(0, -first), min(count, length * factor - first)
    return (first + np.arange(low, max(low, high))) // factor, np.s_[low : max(low, high)]


def _joined(
    values: NDArray[np.float32], rows: NDArray[np.int64], cols: NDArray[np.int64], join: np.ufunc
) -> NDArray[np.float32]:
    """Join the values of the cells of each coarse cell; rows and cols are its index, ascending."""
    firsts = (np.flatnonzero(np.diff(index, prepend=-1)) for index in (rows, cols))
    for axis, first in enumerate(firsts):
        values = join.reduceat(values, first, axis=axis)
    return values
