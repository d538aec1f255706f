"""The laws of the path that OMPL finds."""

import math

import numpy as np
import pytest
from drawn_maps import BODY, CAR, clearance_of, cost_of, divided, grid, room

from planner.guide.ompl_search import PathConfig, plan_path
from planner.guide.route import find_route
from planner.motion.path import POINT_SPACING, Path, project
from planner.risk.risk_map import RiskMap

POSE, GOAL = (2.0, 3.0, 0.4), (10.0, 4.0)


def search(cells, pose, goal, seed=3, ahead=5.0) -> Path | None:
    """OMPL's path through a map of which 10 m around the pose are known to the cell."""
    cost = cost_of(cells)
    known = grid(cells)
    near = RiskMap.from_prediction(known.crop(known.frame.square(*pose[:2], 10.0)), None, 0.0)
    route = find_route(cost, (pose[0], pose[1]), goal)
    assert route is not None
    return plan_path(cost, near, np.array(pose), route, ahead, CAR, PathConfig(), seed)


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
    assert turn.max() <= 5 * POINT_SPACING / 0.8 + 0.02


def test_points_of_a_path_are_evenly_spaced():
    path = search(divided(), POSE, GOAL)
    steps = np.hypot(*np.diff(path.points, axis=0).T)
    assert steps.max() <= POINT_SPACING + 1e-9
    assert np.median(steps) == pytest.approx(POINT_SPACING, rel=0.02)


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
