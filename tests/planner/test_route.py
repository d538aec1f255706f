"""The laws of the cheapest route over a cost map."""

import math

import numpy as np
import pytest
from drawn_maps import BODY, FRAME, X, Y, clearance_of, cost_of, divided, prediction, price

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from planner.guide.route import cost_to_go, find_route
from planner.motion.path import Path
from planner.risk.cost_map import WAY_BACK, CostMap, remember


def length(points) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def test_a_route_goes_round_a_wall():
    cells = divided()
    route = find_route(cost_of(cells), (2.0, 3.0), (10.0, 3.0))
    points = Path.through(route, "dijkstra").points
    assert points[0] == pytest.approx([2.0, 3.0])
    assert points[-1] == pytest.approx([10.0, 3.0])
    assert points[:, 1].max() > 8.0
    assert clearance_of(points, cells) >= BODY.half_width
    assert length(route) < 2 * math.hypot(4.0, 6.5) * 1.15


def test_there_is_no_route_where_all_ways_are_closed():
    assert find_route(cost_of(divided(gap=0.0)), (2.0, 3.0), (10.0, 3.0)) is None


@pytest.mark.parametrize("goal", [(6.0, 3.0), (20.0, 3.0), (-4.0, 3.0)])
def test_there_is_no_route_into_a_wall_or_out_of_the_map(goal):
    cells = divided()
    cells[abs(Y - 3.0) < 1.0] = OCCUPIED
    assert find_route(cost_of(cells), (2.0, 7.0), goal) is None


def test_a_gap_narrower_than_the_body_is_closed():
    assert find_route(cost_of(divided(gap=0.3)), (2.0, 3.0), (10.0, 3.0)) is None
    assert find_route(cost_of(divided(gap=1.0)), (2.0, 3.0), (10.0, 3.0)) is not None


def test_routes_are_as_costly_one_way_as_the_other():
    cost = cost_of(divided())
    there = find_route(cost, (2.0, 3.0), (10.0, 3.0))
    back = find_route(cost, (10.0, 3.0), (2.0, 3.0))
    assert price(cost, Path.through(there, "").points) == pytest.approx(
        price(cost, Path.through(back, "").points), rel=0.03
    )


@pytest.mark.parametrize(("rise", "detours"), [(1.0, True), (4.8, False)])
def test_a_route_goes_round_the_unknown_only_where_that_costs_less(rise, detours):
    # Across the patch: 6 m at 1.4 times the cost are 2.4 too many. Round it: 2·(√(r² + 1) - 1).
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[np.ix_((3.0 + rise) > Y, abs(X - 6.0) < 3.0)] = UNKNOWN
    route = find_route(cost_of(cells), (2.0, 3.0), (10.0, 3.0))
    assert (route[:, 1].max() > 3.0 + rise - 0.3) == detours


def test_a_route_crosses_the_unknown_but_nothing_seen_occupied():
    cells = divided(gap=0.0)
    cells[np.ix_(abs(Y - 5.0) < 0.6, abs(X - 6.0) < 0.1)] = UNKNOWN
    route = find_route(cost_of(cells), (2.0, 3.0), (10.0, 3.0))
    points = Path.through(route, "").points
    assert points[np.argmin(abs(points[:, 0] - 6.0)), 1] == pytest.approx(5.0, abs=0.5)


def test_a_believed_dead_end_steers_the_route_away():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    p_occupied = np.zeros(FRAME.shape, np.float32)
    p_occupied[np.ix_(Y < 7.0, abs(X - 6.0) < 0.3)] = 1.0
    belief = remember(None, FRAME, prediction(1 - p_occupied, p_occupied, 0.9))
    plain = find_route(cost_of(cells), (2.0, 3.0), (10.0, 3.0))
    steered = find_route(cost_of(cells, belief), (2.0, 3.0), (10.0, 3.0))
    assert plain[:, 1].max() < 4.0
    assert steered[:, 1].max() > 6.8


@pytest.mark.parametrize("resolution", [0.05, 0.1])
@pytest.mark.parametrize("slope", [0.0, 0.5, 0.75, 1.0, 1.5])
def test_a_sure_wall_has_no_gap_however_thin_and_steep_it_is(resolution, slope):
    count = round(24.0 / resolution)
    frame = GridFrame(resolution, (0.0, 0.0), (count, count))
    rows, cols = np.mgrid[:count, :count] - count // 2
    costs = []
    for wall in (abs(cols - slope * rows) <= 0.5 * max(1.0, slope), np.zeros((1, 1), np.bool_)):
        p_free = np.where(wall, 0.0, 1.0)
        belief = remember(None, frame, prediction(p_free, 1.0 - p_free, frame=frame))
        cost = CostMap.build(OccupancyGrid(frame, 5.0), belief, BODY.half_width)
        towards = cost_to_go(cost, (20.0, 12.0))
        costs.append(towards.values[towards.values.shape[0] // 2, 20])
    assert 0.7 * WAY_BACK < costs[0] - costs[1] < 1.3 * WAY_BACK


@pytest.mark.parametrize(("end", "round_it"), [(16.0, True), (20.0, False)])
def test_a_sure_wall_is_crossed_only_where_the_way_round_it_is_longer_than_the_way_back(
    end, round_it
):
    # The way round is 2·(√(end² + 3.5²) - 3.5) longer: 25.8 m, or 33.6 m.
    frame = GridFrame(0.05, (0.0, -25.0), (1000, 300))
    x, y = frame.centres()
    p_free = np.ones(frame.shape, np.float32)
    p_free[np.ix_(y < end, abs(x - 7.53) < 0.02)] = 0.0
    belief = remember(None, frame, prediction(p_free, 1.0 - p_free, frame=frame))
    cost = CostMap.build(OccupancyGrid(frame, 5.0), belief, BODY.half_width)
    route = find_route(cost, (4.0, 0.0), (11.0, 0.0))
    assert (route[:, 1].max() > end - 0.5) == round_it
