"""The predictor that predicts nothing: unobserved cells stay unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import Grid
from foresee.prediction import Prediction


class NoPrediction:
    """A predictor that predicts nothing: the baseline."""

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Return the observed cells, with confidence 0 elsewhere."""
        return Prediction(
            frame=known.frame,
            p_free=known.free.astype(np.float32),
            p_occupied=known.occupied.astype(np.float32),
            confidence=(~known.unknown).astype(np.float32),
        )
