"""The predictor that predicts nothing: unobserved cells stay unknown."""

from __future__ import annotations

import numpy as np

from foresee.prediction import Prediction, View


class NoPrediction:
    """A predictor that predicts nothing: the baseline."""

    context_side = 0.0

    def predict(self, view: View) -> Prediction:
        """Return the observed cells, with confidence 0 elsewhere."""
        known = view.known
        return Prediction(
            frame=known.frame,
            p_free=known.free.astype(np.float32),
            p_occupied=known.occupied.astype(np.float32),
            confidence=(~known.unknown).astype(np.float32),
        )
