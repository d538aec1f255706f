"""Far predictions: coarse cells, which change routes far ahead and nothing else."""

import numpy as np
import pytest
from short_drive import drive, straight

from foresee.mapping.context import FAR_CELL, FINER, SIDE, coarse_map
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, OccupancyGrid
from foresee.prediction import Prediction
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.risk.cost_map import (
    FAR_LANES,
    WAY_BACK,
    Belief,
    blocked_cost,
    coarsened,
    remember_far,
)

FRAME = GridFrame(0.05, (-3.0, 2.0), (800, 800))


class Asked:
    """A far predictor that expects free space everywhere, and counts the questions."""

    context_side = 0.0

    def __init__(self, wrong=False):
        self.frames, self.wrong = [], wrong

    def predict(self, view):
        if self.wrong:
            raise RuntimeError("no map")
        self.frames.append(view.known.frame)
        ones = np.ones(view.known.frame.shape, np.float32)
        return Prediction(view.known.frame, ones, 0.0 * ones, ones)


def driven(far, waypoints=None):
    task = straight()
    known = task.blank(5.0)
    start = np.array(task.start)
    driver = Navigator(
        NavigatorConfig(), None, start, task.goal, known, waypoints, task.seed, far=far
    )
    return drive(task, driver)


def test_a_coarse_cell_is_free_as_a_whole_and_occupied_in_part():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[:10, :5] = FREE
    cells[7, 2] = UNKNOWN
    cells[10:15, :5] = FREE
    cells[12, 3] = OCCUPIED
    coarse = coarse_map(Grid(FRAME, cells))
    assert coarse.frame == GridFrame(FAR_CELL, FRAME.origin, (FINER, FINER))
    assert coarse.cells[:3, 0].tolist() == [FREE, UNKNOWN, OCCUPIED]
    assert (coarse.cells == UNKNOWN).sum() == FINER**2 - 2


def test_a_far_prediction_is_remembered_where_its_cells_lie():
    known = GridFrame(0.05, (0.0, 0.0), (200, 300))
    frame = GridFrame(FAR_CELL, (2.1, -1.0), (16, 16))
    free = np.random.default_rng(0).random(frame.shape).astype(np.float32)
    far = Prediction(frame, free, 1 - free, np.ones_like(free))
    belief = remember_far(None, known, far)
    assert belief.frame == coarsened(known)
    for x, y in ((2.15, 0.05), (3.25, 1.95), (6.05, 2.95)):
        cell = belief.frame.cell(x, y)
        wanted = free[frame.cell(x, y)]
        assert belief.free[cell] == pytest.approx(wanted)
        assert blocked_cost(belief.blocked, 0.4)[cell] == pytest.approx(
            WAY_BACK / 0.4 * (1 - wanted) ** FAR_LANES, rel=1e-4
        )
    x, y = belief.frame.centres()
    inside = (x > 2.1)[None] & (x < 6.1)[None] & (y < 3.0)[:, None]
    assert np.array_equal(np.isfinite(belief.free), inside)


def test_a_near_prediction_counts_more_than_a_far_one():
    near, far = np.full((2, 40, 40), np.nan, np.float32), np.full((2, 40, 40), 0.3, np.float32)
    near[:, :10] = 0.9
    frame = GridFrame(0.1, (0.0, 0.0), (40, 40))
    both = Belief(frame, *near).over(Belief(frame, *far))
    assert (both.free[:10] == np.float32(0.9)).all()
    assert (both.free[10:] == np.float32(0.3)).all()
    assert np.array_equal(both.free, both.blocked)


def test_it_is_asked_about_the_square_around_the_car_when_a_route_is_planned():
    far = Asked()
    episode = driven(far)
    assert episode.outcome == "reached"
    assert 1 < len(far.frames) < len(episode.trace["states"]) / 3
    assert {frame.shape for frame in far.frames} == {(FINER, FINER)}
    middles = np.array([np.add(frame.origin, 0.5 * SIDE) for frame in far.frames])
    states = episode.trace["states"]
    gaps = np.hypot(*(middles[:, None] - states[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    # It is the square around the place where the new path begins.
    assert gaps.max() < 1.0


def test_a_prescribed_route_needs_no_far_prediction():
    far = Asked()
    assert driven(far, np.array([[15.0, 2.0]])).outcome == "reached"
    assert not far.frames


def test_a_far_predictor_that_fails_is_counted_and_the_car_arrives():
    episode = driven(Asked(wrong=True))
    assert episode.outcome == "reached"
    assert episode.faults["far_failed"] > 0


def test_a_map_of_another_resolution_gives_coarse_cells_too():
    frame = GridFrame(0.1, (0.0, 0.0), (400, 400))
    known = OccupancyGrid.from_grid(Grid(frame, np.full(frame.shape, FREE, np.int8)), 5.0)
    coarse = coarse_map(known.crop(known.frame.square(20.0, 20.0, SIDE)))
    assert coarse.frame.resolution == FAR_CELL
    assert (coarse.cells == FREE).all()
