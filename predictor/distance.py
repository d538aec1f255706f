"""The rule of distance: unobserved space is free, with a trust that falls with the distance.

The fall decides how far the plan reaches beyond observed space at a reliance of 0.05, compared
with the last resort. In 30 validation buildings (5 families, seeds from 1500, a last resort that
reaches 0.5 m), the car needed 0.88 (0.85–0.90) times the time of `known` with a fall of 0.02 a
metre, and 0.92 (0.90–0.96) with 0.1.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from foresee.prediction import Prediction, View

FALL = 0.02
"""Fall of the trust over a metre [1/m]: at a level λ, the last resort may enter cells up to λ/FALL
from observed free space."""


class Distance:
    """A predictor without a network: the baseline that a network must beat at the same risk.

    Every unobserved cell is free; the trust in it is 1 less `FALL` times its distance from the
    nearest cell that was observed free, at least 0.
    """

    context_side = 0.0

    def predict(self, view: View) -> Prediction:
        """Return the observed map, and unobserved cells as free, trusted less the further off."""
        known = view.known
        confidence = np.zeros(known.frame.shape)
        if known.free.any():
            distance = distance_transform_edt(~known.free) * known.frame.resolution
            confidence = np.clip(1.0 - FALL * distance, 0.0, None)
        confidence[~known.unknown] = 1.0
        occupied = known.occupied.astype(np.float32)
        return Prediction(known.frame, 1.0 - occupied, occupied, confidence.astype(np.float32))
