"""What the predictor expected in each tick of a drive, as it is saved."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.runs.beliefs import BLOCK, CERTAIN, Beliefs
from foresee.mapping.grid import GridFrame
from foresee.prediction import Prediction

BUILDING = GridFrame(0.05, (-1.0, 2.0), (80, 120))


def decision(row, col, p_free, confidence=1.0):
    """A decision with a prediction of 8 × 12 cells from a cell of the building."""
    x, y = BUILDING.centre(row, col)
    frame = GridFrame(0.05, (x - 0.025, y - 0.025), (8, 12))
    free = np.full(frame.shape, p_free)
    known = SimpleNamespace(prediction=Prediction(frame, free, 1.0 - free, free * 0 + confidence))
    return known


def arrays(*decisions):
    beliefs = Beliefs(BUILDING)
    for each in decisions:
        beliefs.observe(each)
    return beliefs.arrays()


def test_a_belief_is_confidence_times_free_minus_occupied():
    out = arrays(decision(8, 4, 1.0), decision(12, 4, 0.0), decision(8, 8, 1.0, 0.5))
    assert out["belief_corners"].tolist() == [[2, 1], [3, 1], [2, 2]]
    assert out["beliefs"].shape == (3, 2, 3)
    assert [set(tick.ravel().tolist()) for tick in out["beliefs"]] == [{7}, {-7}, {4}]


def test_blocks_lie_at_the_same_place_whatever_the_predicted_square():
    out = arrays(decision(9, 6, 1.0))
    assert out["belief_corners"].tolist() == [[2, 1]]
    # The square begins a cell above the block's first row, and two right of its first column.
    inside = np.outer([3, 4, 1], [2, 4, 4, 2]) / BLOCK**2
    assert out["beliefs"][0].tolist() == np.rint(CERTAIN * inside).astype(int).tolist()


def test_a_tick_without_a_prediction_has_no_belief():
    nothing = SimpleNamespace(prediction=None)
    out = arrays(nothing, decision(-4, 0, 1.0))
    assert not out["beliefs"][0].any()
    assert out["belief_corners"][1].tolist() == [-1, 0]
    assert arrays(nothing, nothing) == {}


@pytest.mark.parametrize("arm", ["known", "predicted"])
def test_a_drive_keeps_its_beliefs(arm):
    from benchmarks.compare import drive

    run = drive("corridor", seed=3, arms=(arm,), predictor="distance", route="fixed")
    trace = run.trace(0, arm)
    assert ("beliefs" in trace) == (arm == "predicted")
    if "beliefs" in trace:
        beliefs, corners = trace.read("beliefs"), trace.read("belief_corners")
        tick = len(beliefs) // 2
        rows, cols = np.nonzero(beliefs[tick] == CERTAIN)
        cells = (np.column_stack([rows, cols]) + corners[tick]) * BLOCK
        # Cells around the car have been observed free, which the predictor leaves as they are.
        car = trace.truth.frame.cell(*trace.states[tick, :2])
        assert np.abs(cells + BLOCK / 2 - car).max(axis=1).min() <= BLOCK
