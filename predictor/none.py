"""No prediction: what has not been seen is not known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.grid import Grid
from predictor.prediction import Prediction


class NoPrediction:
    """Believes nothing of unknown cells, and with no confidence; the baseline of every table."""

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Give back what has been seen, and nothing else."""
        return Prediction(
            frame=known.frame,
            p_free=known.free.astype(np.float32),
            p_occupied=known.occupied.astype(np.float32),
            confidence=(~known.unknown).astype(np.float32),
        )
