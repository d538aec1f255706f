"""The beliefs of a drive: what the predictor expected in each tick, coarse enough to be saved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame
from foresee.prediction import Prediction
from planner.decision import Decision

BLOCK = 4
"""Side of a coarse cell [cells of the building's map]."""
CERTAIN = 7
"""Belief that a cell is free for certain; -`CERTAIN`: that it is occupied for certain."""


class Beliefs:
    """Observes a drive, and keeps the prediction of each tick.

    The coarse cells are blocks of the building's map. The belief of one is the mean over its cells
    of confidence · (p_free - p_occupied), times `CERTAIN`, rounded; 0 outside of the prediction.

    Args:
        frame: frame of the building's map.
    """

    def __init__(self, frame: GridFrame) -> None:
        self._frame = frame
        self._ticks: list[tuple[tuple[int, int], NDArray[np.int8]] | None] = []

    def observe(self, decision: Decision) -> None:
        """Keep the prediction of a tick, if there is one."""
        prediction = decision.prediction
        self._ticks.append(None if prediction is None else self._coarse(prediction))

    def arrays(self) -> dict[str, NDArray[np.int8] | NDArray[np.int32]]:
        """Return the beliefs, and the row and column of their first coarse cells.

        They are `beliefs`, (T, rows, columns), and `belief_corners`, (T, 2), as in
        `benchmarks.runs.moment.SHAPES`. There is none if no tick had a prediction.
        """
        given = [tick for tick in self._ticks if tick is not None]
        if not given:
            return {}
        largest = np.max([cells.shape for _, cells in given], axis=0)
        beliefs = np.zeros((len(self._ticks), *largest), np.int8)
        corners = np.zeros((len(self._ticks), 2), np.int32)
        for number, tick in enumerate(self._ticks):
            if tick is not None:
                corners[number], cells = tick
                beliefs[number, : cells.shape[0], : cells.shape[1]] = cells
        return {"beliefs": beliefs, "belief_corners": corners}

    def _coarse(self, prediction: Prediction) -> tuple[tuple[int, int], NDArray[np.int8]]:
        """Return row and column of the first coarse cell of a prediction, and its beliefs."""
        p_free, p_occupied = prediction.p_free, prediction.p_occupied
        values = prediction.confidence * (p_free - p_occupied)
        corner = self._frame.offset(prediction.frame)
        before = [start % BLOCK for start in corner]
        after = [-(a + size) % BLOCK for a, size in zip(before, values.shape, strict=True)]
        padded = np.pad(values, list(zip(before, after, strict=True)))
        rows, cols = padded.shape[0] // BLOCK, padded.shape[1] // BLOCK
        means = padded.reshape(rows, BLOCK, cols, BLOCK).mean(axis=(1, 3))
        first = corner[0] // BLOCK, corner[1] // BLOCK
        return first, np.rint(CERTAIN * means).astype(np.int8)
