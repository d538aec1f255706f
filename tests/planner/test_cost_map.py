"""The laws of the cost map and of the remembered predictions in it."""

import numpy as np
import pytest
from drawn_maps import BODY, FRAME, X, Y, cost_of, grid, prediction, price

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from planner.motion.path import Path
from planner.risk.cost_map import (
    AVOIDED_COST,
    STUCK_REACH,
    UNKNOWN_COST,
    WALL_PRIOR,
    WALL_REACH,
    WAY_BACK,
    CostMap,
    blocked_cost,
    coarsened,
    remember,
)


def test_a_metre_of_unknown_space_costs_more_than_one_of_free_space():
    line = np.column_stack([np.linspace(2.0, 10.0, 81), np.full(81, 5.0)])
    unseen = np.full(FRAME.shape, UNKNOWN, np.int8)
    free = np.full(FRAME.shape, FREE, np.int8)
    assert price(cost_of(free), line) == pytest.approx(8.0)
    assert price(cost_of(unseen), line) == pytest.approx(UNKNOWN_COST * 8.0)


def test_a_metre_costs_as_many_times_more_as_it_is_slower():
    line = np.column_stack([np.linspace(2.0, 10.0, 81), np.full(81, 5.0)])
    cost = cost_of(np.full(FRAME.shape, FREE, np.int8))
    slowness = np.where(line[:, 0] < 6.05, 1.0, 3.0)
    assert cost.along(line, slowness) == pytest.approx(4.0 + 3.0 * 4.0)


def test_the_unknown_costs_more_beside_a_wall_and_less_and_less_away_from_it():
    # A wall at x = 6 m, seen from the left alone.
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[:, X < 6.0] = FREE
    cells[:, abs(X - 6.0) < 0.1] = OCCUPIED
    x, _ = coarsened(FRAME).centres()
    density = cost_of(cells).density[50]
    behind, beyond = (x > 6.8) & (x < 6.1 + WALL_REACH), x > 6.1 + WALL_REACH + 0.1
    assert (np.diff(density[behind]) < 0.0).all()
    assert UNKNOWN_COST < density[behind].max() < UNKNOWN_COST + WALL_PRIOR
    assert density[beyond] == pytest.approx(UNKNOWN_COST)
    # What was seen costs no more for it.
    assert density[x < 5.2] == pytest.approx(1.0)


def test_the_unknown_around_a_place_where_the_car_was_stuck_costs_what_a_wall_does():
    half = np.full(FRAME.shape, FREE, np.int8)
    half[:, 120:] = UNKNOWN
    known, stuck = grid(half), np.array([[7.0, 5.0]])
    plain = CostMap.build(known, None, BODY.half_width)
    barred = CostMap.build(known, None, BODY.half_width, stuck=stuck)
    x, y = plain.frame.centres()
    near = (abs(x - 7.0) < STUCK_REACH) & (x > 6.0) & (abs(y[:, None] - 5.0) < STUCK_REACH)
    assert (barred.density[near] >= AVOIDED_COST).all()
    far = (abs(x - 7.0) > STUCK_REACH + 0.2) | (abs(y[:, None] - 5.0) > STUCK_REACH + 0.2)
    seen = np.broadcast_to(x < 6.0, far.shape)
    assert np.array_equal(barred.density[far | seen], plain.density[far | seen])


SURE_WALL = blocked_cost(np.float32(1.0), 0.4)
"""Additional cost of a metre of what is certainly blocked."""


def test_a_belief_moves_the_price_of_what_was_not_seen_and_of_nothing_else():
    half = np.full(FRAME.shape, FREE, np.int8)
    half[:, 120:] = UNKNOWN
    plain = cost_of(half).density
    for p_free, p_occupied, density in [
        (1.0, 0.0, 1.0),
        (0.0, 1.0, UNKNOWN_COST + SURE_WALL),
        (0.0, 0.0, UNKNOWN_COST + SURE_WALL),
    ]:
        belief = remember(None, FRAME, prediction(p_free, p_occupied))
        steered = cost_of(half, belief).density
        # A body in the last two columns before a predicted obstacle would be too close to it.
        assert np.array_equal(steered[:, :58], plain[:, :58])
        assert steered[:, 60:] == pytest.approx(density)


def test_no_confidence_is_the_price_of_the_unknown():
    belief = remember(None, FRAME, prediction(0.3, 0.7, 0.0))
    unseen = np.full(FRAME.shape, UNKNOWN, np.int8)
    assert cost_of(unseen, belief).density == pytest.approx(cost_of(unseen).density)


def crossing(p_free, thickness):
    """Cost of crossing an unobserved strip of some cells, beyond what free space costs [m]."""
    unseen = np.full(FRAME.shape, UNKNOWN, np.int8)
    values = np.ones(FRAME.shape, np.float32)
    values[:, 120 : 120 + thickness] = p_free
    belief = remember(None, FRAME, prediction(values, 1.0 - values))
    line = np.column_stack([np.linspace(2.0, 10.0, 81), np.full(81, 5.0)])
    return price(cost_of(unseen, belief), line) - 8.0


def test_a_sure_wall_costs_the_way_back_even_if_it_is_one_cell_thick():
    # More than the route search pays, whose cells take the least cost of four.
    assert WAY_BACK < crossing(0.0, 1) < 1.6 * WAY_BACK


def test_a_doubt_costs_little_however_far_it_extends():
    assert crossing(0.6, 80) < 0.1 * WAY_BACK
    assert crossing(0.5, 80) < 0.4 * WAY_BACK < crossing(0.0, 1)


def test_a_cost_grows_with_the_probability_that_a_cell_is_blocked():
    costs = [crossing(p, 4) for p in np.linspace(1.0, 0.0, 11)]
    assert (np.diff(costs) > 0.0).all()
    # From an even chance to certainty, more than from none to an even chance.
    assert costs[10] - costs[5] > 10.0 * (costs[5] - costs[0])


def test_a_predicted_wall_is_as_wide_as_the_body_makes_it():
    unseen = np.full(FRAME.shape, UNKNOWN, np.int8)
    values = np.ones(FRAME.shape, np.float32)
    values[:, 120] = 0.0
    belief = remember(None, FRAME, prediction(values, 1.0 - values))
    for half_width, cells in [(0.05, 3), (0.15, 5), (0.25, 7)]:
        cost = CostMap.build(grid(unseen), belief, half_width)
        assert (cost.density[50] > 2.0).sum() == cells
        # As many cells are too close to a wall that was observed.
        observed = CostMap.build(grid(np.where(values, FREE, OCCUPIED)), None, half_width)
        assert (observed.clearance[50] < observed.required).sum() == cells


def test_a_belief_is_remembered_where_nothing_new_is_predicted():
    left = GridFrame(0.05, (0.0, 0.0), (200, 120))
    right = GridFrame(0.05, (6.0, 0.0), (200, 120))
    belief = remember(None, FRAME, prediction(0.0, 1.0, frame=left))
    assert np.isnan(belief.free[:, 60:]).all()
    assert np.isnan(belief.blocked[:, 60:]).all()
    belief = remember(belief, FRAME, prediction(1.0, 0.0, frame=right))
    assert (belief.blocked[:, :60] == 1.0).all()
    assert (belief.free[:, :60] == 0.0).all()
    assert (belief.blocked[:, 60:] == 0.0).all()
    assert (belief.free[:, 60:] == 1.0).all()


def test_a_prediction_may_reach_beyond_the_map_and_begin_within_a_coarse_cell():
    rng = np.random.default_rng(0)
    for row, col in [(-7, -3), (5, 180), (1, 1), (180, 230), (300, 0), (-500, 0)]:
        frame = GridFrame(0.05, (0.05 * col, 0.05 * row), (61, 83))
        trust = rng.random(frame.shape).astype(np.float32)
        belief = remember(None, FRAME, prediction(trust, 1.0 - trust, frame=frame))
        for i, j in rng.integers((0, 0), belief.frame.shape, (200, 2)):
            rows, cols = (np.array([2 * k, 2 * k + 1]) - o for k, o in ((i, row), (j, col)))
            rows, cols = (
                index[(index >= 0) & (index < n)]
                for index, n in zip((rows, cols), frame.shape, strict=True)
            )
            part = trust[np.ix_(rows, cols)]
            if part.size:
                assert belief.free[i, j] == pytest.approx(part.mean(), abs=1e-6)
                assert belief.blocked[i, j] == pytest.approx(1.0 - part.min(), abs=1e-6)
            else:
                assert np.isnan(belief.free[i, j])
                assert np.isnan(belief.blocked[i, j])


def test_the_newest_word_on_a_cell_counts():
    belief = remember(None, FRAME, prediction(0.0, 1.0))
    belief = remember(belief, FRAME, prediction(1.0, 0.0))
    assert (belief.free == 1.0).all()
    assert (belief.blocked == 0.0).all()


def test_a_belief_outlives_the_growth_of_the_map():
    belief = remember(None, FRAME, prediction(0.0, 1.0))
    known = OccupancyGrid(FRAME, 5.0)
    known.mark_free((-3.0, -4.0, 0.0), BODY, 0.5)
    assert known.frame != FRAME
    row, col = (n // 2 for n in known.frame.offset(FRAME))
    for moved, value in zip(belief.on(coarsened(known.frame)), (0.0, 1.0), strict=True):
        assert (moved[row : row + 100, col : col + 120] == value).all()
        assert np.isnan(moved).sum() == moved.size - 100 * 120


def test_a_belief_does_not_move_the_price_of_a_way_that_is_the_task():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    cells[np.ix_(abs(Y - 2.0) < 1.5, abs(X - 2.0) < 1.5)] = FREE
    way = Path.through(np.array([[2.0, 2.0], [2.0, 8.0], [9.0, 8.0]]), "given").points
    for p_free, p_occupied in [(1.0, 0.0), (0.0, 1.0)]:
        belief = remember(None, FRAME, prediction(p_free, p_occupied))
        plain, steered = (
            CostMap.build(grid(cells), word, BODY.half_width, way) for word in (None, belief)
        )
        assert np.array_equal(steered.density, plain.density)
