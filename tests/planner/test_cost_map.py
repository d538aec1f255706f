"""The laws of the cost map and of the remembered predictions in it."""

import numpy as np
import pytest
from drawn_maps import BODY, FRAME, X, Y, cost_of, grid, prediction, price

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from planner.motion.path import Path
from planner.risk.cost_map import (
    OCCUPIED_COST,
    STUCK_REACH,
    UNKNOWN_COST,
    WALL_PRIOR,
    WALL_REACH,
    CostMap,
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
    assert (barred.density[near] >= OCCUPIED_COST).all()
    far = (abs(x - 7.0) > STUCK_REACH + 0.2) | (abs(y[:, None] - 5.0) > STUCK_REACH + 0.2)
    seen = np.broadcast_to(x < 6.0, far.shape)
    assert np.array_equal(barred.density[far | seen], plain.density[far | seen])


def test_a_belief_moves_the_price_of_what_was_not_seen_and_of_nothing_else():
    half = np.full(FRAME.shape, FREE, np.int8)
    half[:, 120:] = UNKNOWN
    plain = cost_of(half).density
    for p_free, p_occupied, density in [(1.0, 0.0, 1.0), (0.0, 1.0, OCCUPIED_COST)]:
        belief = remember(None, FRAME, prediction(p_free, p_occupied))
        steered = cost_of(half, belief).density
        assert np.array_equal(steered[:, :60], plain[:, :60])
        assert steered[:, 60:] == pytest.approx(density)


def test_no_confidence_is_the_price_of_the_unknown():
    belief = remember(None, FRAME, prediction(0.3, 0.7, 0.0))
    assert belief.density == pytest.approx(UNKNOWN_COST)


def test_a_belief_is_remembered_where_nothing_new_is_predicted():
    left = GridFrame(0.05, (0.0, 0.0), (200, 120))
    right = GridFrame(0.05, (6.0, 0.0), (200, 120))
    belief = remember(None, FRAME, prediction(0.0, 1.0, frame=left))
    assert np.isnan(belief.density[:, 60:]).all()
    belief = remember(belief, FRAME, prediction(1.0, 0.0, frame=right))
    assert belief.density[:, :60] == pytest.approx(OCCUPIED_COST)
    assert belief.density[:, 60:] == pytest.approx(1.0)


def test_the_newest_word_on_a_cell_counts():
    belief = remember(None, FRAME, prediction(0.0, 1.0))
    belief = remember(belief, FRAME, prediction(1.0, 0.0))
    assert belief.density == pytest.approx(1.0)


def test_a_belief_outlives_the_growth_of_the_map():
    belief = remember(None, FRAME, prediction(0.0, 1.0))
    known = OccupancyGrid(FRAME, 5.0)
    known.mark_free((-3.0, -4.0, 0.0), BODY, 0.5)
    assert known.frame != FRAME
    moved = belief.on(coarsened(known.frame))
    row, col = (n // 2 for n in known.frame.offset(FRAME))
    assert moved[row : row + 100, col : col + 120] == pytest.approx(OCCUPIED_COST)
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
