"""The cost map: what a metre of way costs, for finding where to go.

Where to go is a matter of cost, not of safety: space not yet seen may be crossed, at a price,
and a prediction moves that price. What may be relied upon is the risk map's business.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.distance import distance_field
from predictor import GridFrame, OccupancyGrid, Prediction

UNKNOWN_COST = 2.0
"""A metre of unknown space costs as much as this many metres of free space."""
OCCUPIED_COST = 20.0
"""Likewise a metre of space that is believed to be occupied."""


@dataclass(frozen=True, eq=False)
class CostMap:
    """Cost of way, on cells of about 0.1 m.

    Attributes:
        frame: where the cells lie.
        density: cost of a metre [1], (rows, columns).
        clearance: distance to the nearest cell seen occupied [m], (rows, columns).
        required: clearance below which the body does not fit [m].
    """

    frame: GridFrame
    density: NDArray[np.float32]
    clearance: NDArray[np.float32]
    required: float

    @classmethod
    def build(
        cls, known: OccupancyGrid, prediction: Prediction | None, half_width: float
    ) -> CostMap:
        """From all that is known and, where it may steer, what is believed.

        Args:
            known: what has been seen.
            prediction: None: it does not steer.
            half_width: of the body [m].
        """
        factor = max(1, round(0.1 / known.frame.resolution))
        rows, cols = (-(-n // factor) for n in known.frame.shape)
        log_odds = np.zeros((rows * factor, cols * factor), dtype=np.int8)
        log_odds[: known.frame.shape[0], : known.frame.shape[1]] = known.log_odds
        worst = log_odds[::factor, ::factor].copy()
        unseen = worst == 0
        for i in range(factor):
            for j in range(factor):
                part = log_odds[i::factor, j::factor]
                np.maximum(worst, part, out=worst)
                unseen |= part == 0
        occupied = worst > 0
        frame = GridFrame(known.frame.resolution * factor, known.frame.origin, (rows, cols))
        clearance = distance_field(occupied) * np.float32(frame.resolution)
        density = np.where(unseen, np.float32(UNKNOWN_COST), np.float32(1.0))
        if prediction is not None:
            _steer(density, unseen, known.frame, prediction, factor)
        # Keep to the middle where there is room: 0.7 m and more costs nothing.
        comfort = half_width + 0.55
        density += np.float32(2.0) * np.clip(1.0 - clearance / comfort, 0.0, None)
        return cls(frame, density.astype(np.float32), clearance, half_width + 0.12)

    def at(self, values: NDArray[np.float32], x: float, y: float) -> float:
        """A value of this map at a point [m]; 0 outside."""
        row, col = self.frame.cell(x, y)
        if 0 <= row < self.frame.shape[0] and 0 <= col < self.frame.shape[1]:
            return float(values[row, col])
        return 0.0

    def blocks(self, points: NDArray[np.float64]) -> bool:
        """Whether the body does not fit at one of the points (n, 2) [m]."""
        cols = np.floor((points[:, 0] - self.frame.origin[0]) / self.frame.resolution).astype(int)
        rows = np.floor((points[:, 1] - self.frame.origin[1]) / self.frame.resolution).astype(int)
        inside = (rows >= 0) & (rows < self.frame.shape[0])
        inside &= (cols >= 0) & (cols < self.frame.shape[1])
        return bool((self.clearance[rows[inside], cols[inside]] < self.required).any())


def _steer(
    density: NDArray[np.float32],
    unseen: NDArray[np.bool_],
    frame: GridFrame,
    prediction: Prediction,
    factor: int,
) -> None:
    """Price the unseen cells by what is believed of them, in place; no confidence, no change."""
    row, col = frame.offset(prediction.frame)
    trust = prediction.confidence
    believed = (
        UNKNOWN_COST
        + (1.0 - UNKNOWN_COST) * trust * prediction.p_free
        + (OCCUPIED_COST - UNKNOWN_COST) * trust * prediction.p_occupied
    )
    rows = (row + np.arange(believed.shape[0])) // factor
    cols = (col + np.arange(believed.shape[1])) // factor
    keep_r = (rows >= 0) & (rows < density.shape[0])
    keep_c = (cols >= 0) & (cols < density.shape[1])
    believed, rows, cols = believed[np.ix_(keep_r, keep_c)], rows[keep_r], cols[keep_c]
    if believed.size == 0:
        return
    top, left = rows[0], cols[0]
    shape = (rows[-1] - top + 1, cols[-1] - left + 1)
    flat = ((rows - top)[:, None] * shape[1] + (cols - left)[None, :]).ravel()
    total = np.bincount(flat, believed.ravel(), shape[0] * shape[1]).reshape(shape)
    count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
    here = (slice(top, top + shape[0]), slice(left, left + shape[1]))
    density[here][unseen[here]] = (total / count)[unseen[here]]
