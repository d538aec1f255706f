"""Maps as values of nav_msgs/OccupancyGrid: probabilities from 0 to 100, and -1 for unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import UNKNOWN
from foresee.prediction import Prediction

LOG_ODDS = 0.05
"""Unit of the log-odds of an `OccupancyGrid`."""


def observed_values(log_odds: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the probability that each cell is occupied, by what was observed [%].

    Args:
        log_odds: log-odds of an `OccupancyGrid`, (rows, columns).

    Returns:
        Values from 0 to 100; -1 where nothing was observed, (rows, columns).
    """
    levels = np.arange(-128, 128, dtype=np.float64)
    percent = np.round(100.0 / (1.0 + np.exp(-LOG_ODDS * levels))).astype(np.int8)
    percent[128] = UNKNOWN  # a log-odds of 0
    return np.asarray(percent[log_odds.astype(np.int16) + 128])


def predicted_values(prediction: Prediction, confidence: float) -> NDArray[np.int8]:
    """Return the probability that each cell is not free, by a prediction [%].

    Args:
        prediction: prediction, which says 0 or 1 of observed cells.
        confidence: least confidence; cells with less are unknown.

    Returns:
        Values from 0 to 100; -1 where unknown, (rows, columns).
    """
    percent = np.round(100.0 * (1.0 - prediction.p_free)).astype(np.int8)
    known = (prediction.confidence >= confidence) & (prediction.confidence > 0.0)
    return np.where(known, percent, np.int8(UNKNOWN))
