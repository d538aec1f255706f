"""Scores against their definitions, written out."""

import numpy as np
import pytest

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from predictor.scoring.scores import EDGES, RINGS, Scores, calibration_interval, cell_rings

LAST = RINGS - 1


def some_cells(seed=0, n=4000):
    rng = np.random.default_rng(seed)
    p = rng.dirichlet([1.0, 0.5, 1.0], n).astype(np.float32)
    truth = np.array([rng.choice(3, p=row / row.sum()) for row in p.astype(float)])
    return p[:, 0], p[:, 1], truth == 0, truth == 1, rng.integers(-1, RINGS, n).astype(np.int8)


def scored(cells):
    scores = Scores()
    scores.add(*cells)
    return scores


def test_scores_are_what_their_definitions_say():
    p_free, p_occupied, free, occupied, ring = cells = some_cells()
    seen = ring < 0
    got = scored(cells).measures()
    p, true = p_free[~seen], free[~seen]
    assert got["cells"] == (~seen).sum()
    assert got["brier_free"] == pytest.approx(((p - true) ** 2).mean(), rel=1e-5)
    assert got["iou_free"] == pytest.approx((true & (p >= 0.5)).sum() / (true | (p >= 0.5)).sum())
    pairs = p[true][:, None] - p[~true][None, :]
    area = (pairs > 0).mean() + 0.5 * (pairs == 0).mean()
    assert got["auc_free"] == pytest.approx(area, abs=1e-3)
    hidden = 1 - p_free - p_occupied
    of_truth = np.select([free, occupied], [p_free, p_occupied], hidden)[~seen]
    assert got["nll"] == pytest.approx(-np.log(np.maximum(of_truth, 1e-6)).mean(), rel=1e-4)


def test_what_was_drawn_from_its_probabilities_is_calibrated():
    got = scored(some_cells(n=20000)).measures()
    assert got["ece_free"] < 0.02
    assert got["ece_occupied"] < 0.02


def test_overconfidence_shows_as_calibration_error():
    p_free, _p_occupied, free, occupied, ring = some_cells()
    sure = np.where(p_free > 0.5, np.float32(1), np.float32(0))
    got = scored((sure, np.zeros_like(sure), free, occupied, ring)).measures()
    assert got["ece_free"] > 0.1


def test_buildings_that_differ_leave_a_calibration_error_in_doubt():
    # Said of every cell: one half. True of nine tenths in one building, of a third in the next.
    bins = np.zeros((24, 20, 3))
    bins[:, 10] = [100.0, 50.0, 30.0]
    bins[::2, 10, 2] = 90.0
    low, high = calibration_interval([list(bins)])
    assert 0.0 <= low < 0.05
    assert 0.2 < high < 0.5
    # Where the two kinds are families, of which there are as many each time, little is left.
    bins[:, 10, 2] += np.linspace(0.0, 1.0, 24)
    low, high = calibration_interval([list(bins[::2]), list(bins[1::2])])
    assert 0.09 < low < 0.105 < high < 0.12


def test_few_buildings_say_nothing_of_others():
    bins = scored(some_cells()).bins("free")
    assert calibration_interval([[bins, bins], [bins]]) is None
    assert calibration_interval([[bins * (1.0 + i) for i in range(19)]]) is None
    assert calibration_interval([[np.zeros((20, 3))] * 30]) is None


def test_scores_of_parts_add_up_to_those_of_the_whole():
    cells = some_cells()
    parts = Scores()
    for start in range(0, 4000, 1000):
        parts += scored(tuple(values[start : start + 1000] for values in cells))
    assert parts.measures() == pytest.approx(scored(cells).measures())


def test_rings_are_scored_apart():
    cells = some_cells()
    scores = scored(cells)
    ring = cells[4]
    for i in range(RINGS):
        assert scores.measures(slice(i, i + 1))["cells"] == (ring == i).sum()


def test_where_nothing_was_scored_there_is_no_figure():
    got = Scores().measures()
    assert got["cells"] == 0
    assert all(np.isnan(value) for name, value in got.items() if name != "cells")


def test_rings_are_distances_beyond_what_was_seen_free():
    cells = np.full((3, 200), UNKNOWN, np.int8)
    cells[:, :10], cells[1, 150] = FREE, OCCUPIED
    ring = cell_rings(Grid(GridFrame(0.05, (0.0, 0.0), cells.shape), cells))
    assert (ring[:, :10] == -1).all()
    assert ring[1, 150] == -1
    distance = 0.05 * (np.arange(200) - 9)
    expected = np.searchsorted(EDGES[1:], distance, side="right")
    assert np.array_equal(ring[0, 10:], expected[10:])


def test_with_nothing_seen_free_every_cell_is_far():
    cells = np.full((5, 5), UNKNOWN, np.int8)
    cells[2, 2] = OCCUPIED
    ring = cell_rings(Grid(GridFrame(0.05, (0.0, 0.0), (5, 5)), cells))
    assert ring[2, 2] == -1
    assert (np.delete(ring.ravel(), 12) == LAST).all()
