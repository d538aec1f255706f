"""The laws of the rule of distance."""

import numpy as np
import pytest

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import View
from predictor.distance import FALL, Distance

FRAME = GridFrame(0.05, (0.0, 0.0), (60, 60))


def trust(cells):
    prediction = Distance().predict(View(Grid(FRAME, cells), np.array([1.0, 1.0, 0.0])))
    return prediction.confidence * prediction.p_free


def test_the_trust_falls_evenly_with_the_distance_from_observed_free_space():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[:, :20] = FREE
    expected = 1.0 - FALL * 0.05 * np.arange(1, 41)
    assert trust(cells)[:, 20:] == pytest.approx(np.tile(expected, (60, 1)), abs=1e-6)


def test_walls_are_not_trusted_and_give_no_trust():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[:, 10] = OCCUPIED
    assert not trust(cells).any()
