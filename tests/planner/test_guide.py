"""The laws of the guide on a way of its own and on a prescribed one."""

import math

import numpy as np
import pytest
from drawn_maps import CAR, FRAME, X, Y, grid, prediction

from foresee.mapping.grid import FREE, UNKNOWN, Grid, GridFrame, OccupancyGrid
from foresee.prediction import Prediction
from planner.guide.guide import Guide
from planner.guide.guide_config import GuideConfig
from planner.motion.path import Path
from planner.risk.risk_map import RiskMap


@pytest.mark.parametrize("given", [True, False])
def test_a_belief_moves_a_way_of_ones_own_but_not_one_that_is_the_task(given):
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[np.ix_(abs(Y - 2.0) < 1.5, abs(X - 2.0) < 1.5)] = FREE
    way = np.array([[2.0, 2.0], [2.0, 8.0], [9.0, 8.0]])
    known, shape = grid(cells), FRAME.shape
    # Far from the way that is given, across the straight line to the goal. Nothing is believed to
    # be free, for there the line may round the corners of either way.
    wall = (abs(X[None, :] - 6.0) < 0.5) & (Y[:, None] < 6.5)
    believed = Prediction(
        FRAME, np.zeros(shape, np.float32), wall.astype(np.float32), np.float32(0.99) * wall
    )
    risk = RiskMap.from_prediction(known.crop(known.frame.square(2.0, 2.0, 10.0)), None, 0.0)
    ahead = np.array([[2.0, 2.0, 0.8, 1.0]])
    paths = []
    for steering in (None, believed):
        guide = Guide((9.0, 8.0), way if given else None, CAR, GuideConfig(), seed=1)
        guide.plan_if_due(0, ahead, known, risk, steering)
        guide.update(GuideConfig().delay, ahead[0], risk)
        assert guide.path is not None
        paths.append(guide.path.points)
    assert np.array_equal(*paths) == given


def followed(way, places) -> np.ndarray:
    """The path of a car that is given a way, has been at some places, and is at the last now.

    It has seen 3 m squares about all of them.
    """
    frame = GridFrame(0.05, (0.0, 0.0), (200, 640))
    x, y = frame.centres()
    cells = np.full(frame.shape, UNKNOWN, np.int8)
    guide = Guide(tuple(way[-1]), way, CAR, GuideConfig(), seed=1)
    for number, at in enumerate(places):
        cells[np.ix_(abs(y - at[1]) < 1.5, abs(x - at[0]) < 1.5)] = FREE
        known = OccupancyGrid.from_grid(Grid(frame, cells), 5.0)
        risk = RiskMap.from_prediction(known.crop(known.frame.square(*at, 10.0)), None, 0.0)
        ahead, tick = np.array([[*at, 0.0, 1.0]]), 10 * number
        guide.plan_if_due(tick, ahead, known, risk, None)
        guide.update(tick + guide.config.delay, ahead[0], risk)
    assert guide.path is not None
    return guide.path.points[guide.segment :]


def test_a_given_way_is_not_left_for_a_short_cut_through_what_has_not_been_seen():
    way = np.array([[2.0, 1.5], [9.0, 1.5], [9.0, 7.5], [2.0, 7.5]])
    assert followed(way, [(2.0, 1.5)])[:, 0].max() > 8.0


def test_a_line_keeps_to_a_given_way_through_what_is_predicted_free():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[np.ix_(abs(Y - 2.0) < 1.5, abs(X - 2.0) < 1.5)] = FREE
    way = np.array([[2.0, 2.0], [2.0, 8.0], [9.0, 8.0]])
    known, free = grid(cells), prediction(1.0, 0.0, 0.99)
    risk = RiskMap.from_prediction(known.crop(known.frame.square(2.0, 2.0, 10.0)), None, 0.0)
    guide = Guide((9.0, 8.0), way, CAR, GuideConfig(), seed=1)
    ahead = np.array([[2.0, 2.0, math.pi / 2, 1.0]])
    # A path that is smoothed again and again must not creep from the way.
    for tick in range(0, 200, 10):
        guide.plan_if_due(tick, ahead, known, risk, free)
        guide.update(tick + guide.config.delay, ahead[0], risk)
    assert guide.path is not None
    corner = np.hypot(*(guide.path.points - [2.0, 8.0]).T).min()
    assert corner < 0.8


def test_a_car_that_was_beside_a_given_way_is_not_called_back():
    way = np.array([[1.0, 2.0], [31.0, 2.0]])
    beside = [(float(x), 3.3) for x in range(2, 11, 2)]
    points = followed(way, [*beside, *((float(x), 2.0) for x in range(12, 22, 2))])
    assert points[:, 0].min() > 18.0


@pytest.mark.parametrize(
    ("before", "after", "back"),
    [
        ([[0, 0], [8, 0]], [[1, 0], [9, 0]], False),
        ([[0, 0], [8, 0]], [[1, 0], [1, 6]], False),
        ([[0, 0], [8, 0]], [[1, 0], [0.5, 1], [-6, 0.5]], True),
        # A bend on both is no reversal.
        ([[0, 0], [2, 0], [2, -6]], [[0.5, 0], [2, 0.2], [2, -6]], False),
        ([[0, 0], [0.05, 0]], [[0, 0], [-5, 0]], True),
        # By 110° and by 130°.
        ([[0, 0], [8, 0]], [[0, 0], [-1.71, 4.7]], False),
        ([[0, 0], [8, 0]], [[0, 0], [-3.21, 3.83]], True),
        # What lies behind the car does not count.
        ([[-3, 0], [0, 0], [0, 6]], [[0, 0], [0, -6]], True),
    ],
)
def test_a_path_that_leads_back_is_counted_as_a_reversal(before, after, back):
    guide = Guide((9.0, 8.0), None, CAR, GuideConfig(), seed=1)
    known = grid(np.full(FRAME.shape, FREE, np.int8))
    risk = RiskMap.from_prediction(known.crop(known.frame.square(2.0, 2.0, 10.0)), None, 0.0)
    for tick, way in enumerate((before, after)):
        guide._pending = tick, Path.through(np.array(way, float), "route")
        guide.update(tick, np.array([0.0, 0.0, 0.0, 1.0]), risk)
    assert guide.counts["reversal"] == back
