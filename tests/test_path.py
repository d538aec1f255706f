"""The laws of the route, the path, and the beliefs that steer them."""

import math

import numpy as np
import pytest

from planner.guide.guide import Guide, GuideConfig
from planner.guide.ompl_search import PathConfig, plan_path
from planner.guide.route import find_route
from planner.motion.path import SPACING, Path, project
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
from planner.risk.risk_map import RiskMap
from predictor import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, OccupancyGrid, Prediction
from predictor.mapping.car_limits import CarLimits

CAR = CarLimits()
BODY = CAR.body
FRAME = GridFrame(0.05, (0.0, 0.0), (200, 240))
X, Y = FRAME.centres()


def grid(cells) -> OccupancyGrid:
    return OccupancyGrid.from_grid(Grid(FRAME, cells), 5.0)


def cost_of(cells, belief=None) -> CostMap:
    return CostMap.build(grid(cells), belief, BODY.half_width)


def room() -> np.ndarray:
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = (OCCUPIED,) * 4
    return cells


def divided(gap: float = 2.0) -> np.ndarray:
    """A room with a wall across it at x = 6 m that leaves a gap at the top [m]."""
    cells = room()
    cells[np.ix_((10.0 - gap) > Y, abs(X - 6.0) < 0.1)] = OCCUPIED
    return cells


def price(cost, points) -> float:
    """What a polyline (n, 2) costs a car that is nowhere slowed down."""
    return cost.along(points, np.ones(len(points)))


def length(points) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def search(cells, pose, goal, seed=3, ahead=5.0) -> Path | None:
    """OMPL's path through a map of which 10 m around the pose are known to the cell."""
    cost = cost_of(cells)
    known = grid(cells)
    near = RiskMap.from_prediction(known.crop(known.frame.square(*pose[:2], 10.0)), None, 0.0)
    route = find_route(cost, (pose[0], pose[1]), goal)
    assert route is not None
    return plan_path(cost, near, np.array(pose), route, ahead, CAR, PathConfig(), seed)


def clearance_of(points, cells) -> float:
    """Least distance from the points to the edge of a cell seen occupied [m]."""
    rows, cols = np.nonzero(cells == OCCUPIED)
    half = 0.5 * FRAME.resolution
    least = math.inf
    for x, y in points:
        dx = np.maximum(abs(X[cols] - x) - half, 0.0)
        dy = np.maximum(abs(Y[rows] - y) - half, 0.0)
        least = min(least, float(np.hypot(dx, dy).min()))
    return least


POSE, GOAL = (2.0, 3.0, 0.4), (10.0, 4.0)


@pytest.mark.parametrize("seed", [0, 1, 12345, 2**40])
def test_the_same_seed_gives_the_same_path(seed):
    first, second = (search(divided(), POSE, GOAL, seed) for _ in range(2))
    assert first is not None
    assert second is not None
    assert np.array_equal(first.points, second.points)


def test_a_path_does_not_depend_on_searches_made_before_it():
    first = search(divided(), POSE, GOAL, 5)
    search(room(), POSE, GOAL, 8)
    second = search(divided(), POSE, GOAL, 5)
    assert np.array_equal(first.points, second.points)


@pytest.mark.parametrize("yaw", [-2.5, -1.0, 0.0, 1.5, math.pi])
@pytest.mark.parametrize("ahead", [4.0, 40.0])
def test_a_path_starts_at_the_pose_along_its_heading_and_ends_at_the_goal(yaw, ahead):
    path = search(room(), (3.0, 5.0, yaw), GOAL, ahead=ahead)
    assert path is not None
    assert path.points[0] == pytest.approx([3.0, 5.0], abs=1e-6)
    assert path.points[-1] == pytest.approx(GOAL, abs=1e-6)
    first = path.points[1] - path.points[0]
    assert abs(math.remainder(math.atan2(first[1], first[0]) - yaw, 2 * math.pi)) < 0.12


@pytest.mark.parametrize("seed", range(3))
def test_no_point_of_a_path_is_closer_to_an_obstacle_than_half_the_bodys_width(seed):
    cells = divided()
    path = search(cells, POSE, GOAL, seed)
    assert path is not None
    assert clearance_of(path.points, cells) >= BODY.half_width


@pytest.mark.parametrize("seed", range(3))
def test_the_drivable_part_of_a_path_turns_no_tighter_than_the_car_can(seed):
    path = search(divided(), POSE, GOAL, seed)
    assert path is not None
    assert 2 < path.drivable <= len(path.points)
    # Three points 0.5 m apart along the path: an arc's chord is shorter than the arc by a third
    # power, so that a tighter turn shows.
    p = path.points[: path.drivable]
    a, b = p[5:-5] - p[:-10], p[10:] - p[5:-5]
    turn = np.abs(
        (np.arctan2(b[:, 1], b[:, 0]) - np.arctan2(a[:, 1], a[:, 0]) + math.pi) % (2 * math.pi)
        - math.pi
    )
    assert turn.max() <= 5 * SPACING / 0.8 + 0.02


def test_points_of_a_path_are_evenly_spaced():
    path = search(divided(), POSE, GOAL)
    steps = np.hypot(*np.diff(path.points, axis=0).T)
    assert steps.max() <= SPACING + 1e-9
    assert np.median(steps) == pytest.approx(SPACING, rel=0.02)


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


def prediction(p_free, p_occupied, confidence=1.0, frame=FRAME) -> Prediction:
    def all_(value):
        return np.broadcast_to(np.float32(value), frame.shape).astype(np.float32)

    return Prediction(frame, all_(p_free), all_(p_occupied), all_(confidence))


def test_a_belief_moves_the_price_of_what_was_not_seen_and_of_nothing_else():
    half = np.full(FRAME.shape, FREE, np.int8)
    half[:, 120:] = UNKNOWN
    plain = cost_of(half).density
    for p_free, p_occupied, price in [(1.0, 0.0, 1.0), (0.0, 1.0, OCCUPIED_COST)]:
        belief = remember(None, FRAME, prediction(p_free, p_occupied))
        steered = cost_of(half, belief).density
        assert np.array_equal(steered[:, :60], plain[:, :60])
        assert steered[:, 60:] == pytest.approx(price)


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


def test_a_believed_dead_end_steers_the_route_away():
    cells = np.full(FRAME.shape, UNKNOWN, np.int8)
    p_occupied = np.zeros(FRAME.shape, np.float32)
    p_occupied[np.ix_(Y < 7.0, abs(X - 6.0) < 0.3)] = 1.0
    belief = remember(None, FRAME, prediction(1 - p_occupied, p_occupied, 0.9))
    plain = find_route(cost_of(cells), (2.0, 3.0), (10.0, 3.0))
    steered = find_route(cost_of(cells, belief), (2.0, 3.0), (10.0, 3.0))
    assert plain[:, 1].max() < 4.0
    assert steered[:, 1].max() > 6.8


def test_a_projection_is_the_closest_point_of_the_path():
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.normal(size=(40, 2)), axis=0)
    dense = Path.through(points, "")
    for x, y in rng.uniform(-5, 5, (50, 2)):
        i, share, square = project(dense.points, x, y, 0, 10**6)
        foot = (1 - share) * dense.points[i] + share * dense.points[i + 1]
        assert np.hypot(*(foot - (x, y))) ** 2 == pytest.approx(square, abs=1e-9)
        nearest = np.hypot(*(dense.points - (x, y)).T).min()
        assert math.sqrt(square) <= nearest + 1e-9


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
        guide.plan_if_due(0, ahead, known, risk, steering, [])
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
        guide.plan_if_due(tick, ahead, known, risk, None, [])
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
        guide.plan_if_due(tick, ahead, known, risk, free, [])
        guide.update(tick + guide.config.delay, ahead[0], risk)
    assert guide.path is not None
    corner = np.hypot(*(guide.path.points - [2.0, 8.0]).T).min()
    assert corner < 0.8


def test_a_car_that_was_beside_a_given_way_is_not_called_back():
    way = np.array([[1.0, 2.0], [31.0, 2.0]])
    beside = [(float(x), 3.3) for x in range(2, 11, 2)]
    points = followed(way, [*beside, *((float(x), 2.0) for x in range(12, 22, 2))])
    assert points[:, 0].min() > 18.0
