"""The level of the last resort falls where predictions prove wrong, and recovers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, OccupancyGrid
from foresee.prediction import Prediction
from planner.risk.adaptive_level import DOUBT_KEPT, SUSTAINED, AdaptiveLevel
from planner.risk.risk_map import RiskMap

FRAME = GridFrame(0.1, (0.0, 0.0), (8, 8))


@given(st.floats(0.0, 0.5), st.lists(st.floats(0, 1), min_size=1, max_size=300))
def test_the_losses_above_level_zero_stay_below_the_bound_whatever_the_losses(allowed, losses):
    level, suffered = AdaptiveLevel(allowed), 0.0
    for loss in losses:
        assert 0.0 <= level.level <= allowed
        # What proves wrong at level 0 was believed before; the last resort no longer relies on it.
        suffered += loss if level.level > 0.0 else 0.0
        level.update(loss)
    assert suffered / len(losses) <= allowed + (SUSTAINED + 1) / len(losses) + 1e-9


def test_it_falls_while_predictions_are_wrong_and_recovers_when_they_are_right():
    level = AdaptiveLevel(0.1)
    seen = []
    for loss in [0.0] * 3 + [0.3] * 3 + [0.0] * 10:
        level.update(loss)
        seen.append(level.level)
    assert seen[:3] == [0.1] * 3
    assert seen[2] > seen[3] > seen[4] > seen[5]
    assert seen[5] < seen[6] < seen[7] < seen[8]
    assert seen[-1] == 0.1


def believing(known, level):
    """The risk map of a prediction that all cells are free, with a trust of 0.95."""
    ones = np.ones(FRAME.shape, np.float32)
    belief = Prediction(FRAME, ones, 0 * ones, 0.95 * ones)
    return RiskMap.from_prediction(known.crop(FRAME), belief, 0.2, level=level)


def map_of(cells):
    return OccupancyGrid.from_grid(Grid(FRAME, cells), 5.0)


@pytest.mark.parametrize(("found", "falls"), [(OCCUPIED, True), (FREE, False), (UNKNOWN, False)])
def test_only_what_is_observed_later_is_checked(found, falls):
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[:, :4] = FREE
    level = AdaptiveLevel(0.1)
    level.believe(believing(map_of(cells), level.level))
    cells[2:5, 5] = found
    level.check(map_of(cells))
    assert (level.level < 0.1) == falls


def test_what_is_seen_later_is_checked_later():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    level = AdaptiveLevel(0.1)
    level.believe(believing(map_of(cells), level.level))
    level.check(map_of(cells))
    # The prediction no longer says so, but it was relied upon.
    level.believe(RiskMap.from_prediction(map_of(cells).crop(FRAME), None, 0.2, level=0.1))
    assert level.level == 0.1
    cells[2, 2] = OCCUPIED
    level.check(map_of(cells))
    assert level.level < 0.1
    fallen = level.level
    level.believe(RiskMap.from_prediction(map_of(cells).crop(FRAME), None, 0.2, level=0.1))
    level.check(map_of(cells))
    # Nothing was checked, so nothing is learned.
    assert level.level == fallen


def test_at_level_zero_it_rises_again_though_nothing_is_checked():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    level = AdaptiveLevel(0.2)
    level.update(1.0)
    assert level.level == 0.0
    for _ in range(20):
        level.believe(believing(map_of(cells), level.level))
        level.check(map_of(cells))
    assert 0.0 < level.level < 0.2


def test_what_is_not_believed_firmly_enough_is_not_checked():
    level = AdaptiveLevel(0.01)
    level.believe(believing(map_of(np.full(FRAME.shape, UNKNOWN, np.int8)), level.level))
    level.check(map_of(np.full(FRAME.shape, OCCUPIED, np.int8)))
    assert level.level == 0.01


def test_without_a_level_nothing_is_believed():
    level = AdaptiveLevel(0.0)
    level.update(1.0)
    assert level.level == 0.0


def test_each_cell_is_checked_once():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    level = AdaptiveLevel(0.1)
    level.believe(believing(map_of(cells), level.level))
    cells[2, :5] = FREE
    cells[2, 2] = OCCUPIED
    level.check(map_of(cells))
    fallen = level.level
    assert 0.0 < fallen < 0.1
    level.check(map_of(cells))
    assert level.level == fallen


def test_what_is_believed_later_is_checked_too():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    level = AdaptiveLevel(0.1)
    # A tick without a prediction, and one with it.
    level.believe(RiskMap.from_prediction(map_of(cells).crop(FRAME), None, 0.2, level=0.1))
    level.believe(believing(map_of(cells), level.level))
    cells[2, 2] = OCCUPIED
    level.check(map_of(cells))
    assert level.level < 0.1


def test_a_level_that_does_not_adapt_stays():
    level = AdaptiveLevel(0.1, adapts=False)
    level.update(1.0)
    assert level.level == 0.1


def test_a_lowered_level_is_divided_by_the_doubt_which_decays():
    level = AdaptiveLevel(0.2)
    level.update(0.45)
    assert level.level == pytest.approx(0.1)
    assert level.doubted(4.0) == pytest.approx(0.1 / 4.0)
    assert level.doubted(1.0) == pytest.approx(0.1 / (4.0 * DOUBT_KEPT))
    assert level.doubted(10.0) == pytest.approx(0.1 / 10.0)
