"""A sham predictor, as a control: all cells have the probability of one just ahead of the car."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Prediction, View, with_observed
from predictor.compact import Compact
from sim.families import empty_straight
from sim.lidar import Lidar

WIDTH, LENGTH = 6.0, 60.0
"""Width and length of the corridor [m]."""
WINDOW, SIDE = 5.0, 10.0
"""Sides of the LIDAR's window and of the predicted square in the corridor [m]."""


class Sham:
    """Predicts free space only, with probabilities that belong to other cells.

    Each unobserved cell has the p_free and the confidence that the shipped network gives to the
    first unobserved cell ahead of a car in a wide corridor. A calibration that was made for the
    network must not hold for the sham; if it did, the study could not show anything.
    """

    context_side = 0.0

    def predict(self, view: View) -> Prediction:
        """Return a prediction with the same probabilities in all unobserved cells."""
        known = view.known
        p_free, confidence = (np.full(known.frame.shape, p, dtype=np.float32) for p in _ahead())
        return with_observed(known, p_free, np.zeros_like(p_free), confidence)


@lru_cache
def _ahead() -> tuple[float, float]:
    """Return p_free and confidence of the first unobserved cell ahead in a corridor."""
    world = empty_straight(LENGTH, WIDTH)
    state = np.array([0.5 + 0.5 * LENGTH, 0.5 + 0.5 * WIDTH, 0.0, 0.0])
    known, compact = OccupancyGrid(world.grid.frame, WINDOW), Compact()
    known.integrate(Lidar().scan(world, state, np.random.default_rng(0)), state)
    view = View.of(known, state[:3], SIDE, compact.context_side)
    answer = compact.predict(view)
    row, col = view.known.frame.cell(float(state[0]), float(state[1]))
    first = col + int(np.argmax(view.known.unknown[row, col:]))
    return float(answer.p_free[row, first]), float(answer.confidence[row, first])
