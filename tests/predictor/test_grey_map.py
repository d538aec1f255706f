"""From greys to probabilities: monotone, and never more than one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from predictor.networks.grey_image import GREY_LEVELS, counted, fitted, grey_level, literal

COUNTS = arrays(np.int64, (GREY_LEVELS, 3), elements=st.integers(0, 10**6), fill=st.just(0))


@given(COUNTS)
def test_free_rises_with_the_grey_and_occupied_falls(counts):
    free, occupied = fitted(counts)
    assert (np.diff(free) >= -1e-12).all()
    assert (np.diff(occupied) <= 1e-12).all()


@given(COUNTS)
def test_the_two_never_exceed_one_and_nothing_is_certain(counts):
    free, occupied = fitted(counts)
    assert (free > 0).all()
    assert (occupied > 0).all()
    assert (free + occupied < 1).all()


@given(COUNTS)
def test_what_was_believed_on_the_whole_came_true(counts):
    cells = counts + 1
    for name, fit in enumerate(fitted(counts)):
        assert np.isclose((fit * cells.sum(axis=1)).sum(), cells[:, name].sum())


def test_rates_that_are_monotone_already_are_kept():
    rng = np.random.default_rng(0)
    truth = np.sort(rng.uniform(0.1, 0.8, GREY_LEVELS))
    counts = np.stack([truth, 0.9 - truth, np.full(GREY_LEVELS, 0.1)], axis=1) * 1e8
    free, occupied = fitted(counts.astype(np.int64))
    assert np.allclose(free, truth, atol=1e-6)
    assert np.allclose(occupied, 0.9 - truth, atol=1e-6)


def test_greys_are_counted_by_level_and_truth():
    grey = np.array([[-1.0, 0.0], [1.0, 1.0]])
    truth = np.array([[1, 2], [0, 1]], np.uint8)
    counts = counted(grey, truth, np.array([[True, True], [True, False]]))
    assert counts.sum() == 3
    assert counts[0, 1] == counts[GREY_LEVELS // 2, 2] == counts[-1, 0] == 1


def test_levels_reach_from_black_to_white_through_grey():
    assert grey_level(np.array([-1.0, 0.0, 1.0])).tolist() == [0, GREY_LEVELS // 2, GREY_LEVELS - 1]


def test_at_their_word_grey_is_nothing_and_white_is_free():
    free, occupied = literal()
    assert (free[0], occupied[0]) == (0.0, 1.0)
    assert (free[-1], occupied[-1]) == (1.0, 0.0)
    assert free[GREY_LEVELS // 2] == occupied[GREY_LEVELS // 2] == 0.0
