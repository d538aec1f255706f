"""The predictor for which all unobserved space is free: for a plan that a last resort backs."""

from __future__ import annotations

import numpy as np

from foresee.prediction import Prediction, View


class Free:
    """A predictor that trusts every cell that was not observed occupied.

    With a last resort in observed cells alone, this is the driver of Tordesillas, Lopez & How 2019
    (FASTER): all unobserved space counts as free for the plan, and a safe trajectory is kept in
    observed space.
    """

    context_side = 0.0

    def predict(self, view: View) -> Prediction:
        """Return all cells that were not observed occupied as free, with confidence 1."""
        known = view.known
        occupied = known.occupied.astype(np.float32)
        return Prediction(known.frame, 1.0 - occupied, occupied, np.ones_like(occupied))
