"""The oracle: a predictor that knows the true map of the building."""

from __future__ import annotations

import numpy as np

from foresee.prediction import Prediction, View
from sim.world import World


class Oracle:
    """A predictor that returns the true map of the square that it is asked about.

    Args:
        world: true map of the building.
        side: side of the square [m]; 0: the one that any predictor is asked about.
    """

    context_side = 0.0

    def __init__(self, world: World, side: float = 0.0) -> None:
        self.world, self.side = world, side

    def predict(self, view: View) -> Prediction:
        """Return the true map with a confidence of 1."""
        frame = view.known.frame
        free, surface = self.world.truth(frame)
        confidence = np.ones(frame.shape, dtype=np.float32)
        return Prediction(frame, free.astype(np.float32), surface.astype(np.float32), confidence)
