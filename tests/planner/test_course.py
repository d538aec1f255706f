"""Whether a car finds back to its path from where a manoeuvre ends."""

import numpy as np
import pytest

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from planner.motion.path import Path
from planner.risk.risk_map import RiskMap
from planner.safety.collision import CollisionChecker
from planner.safety.contact import ON_COURSE, first_free
from planner.safety.course import rejoins
from planner.safety.tube import EXACT

CAR = CarLimits()
CHECKER = CollisionChecker(CAR, 0.1)
FRAME = GridFrame(0.05, (-2.0, -3.0), (120, 240))
X, Y = FRAME.centres()
STRAIGHT = np.array([[0.0, 0.0], [8.0, 0.0]])


def course(cells, vertices=STRAIGHT, segment=0):
    risk = RiskMap.from_prediction(Grid(FRAME, cells), None, 0.0)
    return CHECKER.course_on(Path.through(vertices, "route"), segment, risk)


def corridor(half_width):
    """A corridor along the x axis."""
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[abs(Y) > half_width] = OCCUPIED
    return cells


@pytest.mark.parametrize("yaw", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("y", [-0.5, 0.0, 0.5])
def test_a_car_beside_its_path_finds_back_to_it(y, yaw):
    assert rejoins(np.array([1.0, y, yaw]), course(corridor(2.0)))


def test_a_car_with_its_front_to_a_wall_does_not():
    walls = course(corridor(1.0))
    assert not rejoins(np.array([1.0, 0.6, 1.2]), walls)
    assert rejoins(np.array([1.0, 0.6, 0.2]), walls)
    # Nor past a wall that stands across the path.
    blocked = corridor(1.0)
    blocked[:, abs(X - 3.0) < 0.1] = OCCUPIED
    assert not rejoins(np.array([1.0, 0.0, 0.0]), course(blocked))


def test_a_car_that_has_driven_past_a_turn_does_not_where_there_is_no_room_to_come_round():
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, -2.5]])
    cells = np.full(FRAME.shape, OCCUPIED, np.int8)
    cells[np.ix_(abs(Y) < 0.7, X < 8.0)] = FREE
    cells[np.ix_(Y < 0.7, abs(X - 4.0) < 0.7)] = FREE
    past = course(cells, corner)
    assert not rejoins(np.array([6.0, 0.0, 0.0]), past)
    assert rejoins(np.array([2.0, 0.1, 0.0]), past)


def test_nothing_is_known_against_unobserved_cells_and_what_lies_beyond_the_grid():
    unseen = np.full(FRAME.shape, UNKNOWN, np.int8)
    assert rejoins(np.array([1.0, 0.0, 0.0]), course(unseen))
    long = np.array([[0.0, 0.0], [30.0, 0.0]])
    assert rejoins(np.array([9.5, 0.0, 0.0]), course(unseen, long, 95))
    assert not rejoins(np.array([9.5, 2.0, 1.5]), course(unseen, long, 95))


def test_a_later_part_of_the_path_behind_a_wall_is_not_the_course():
    there_and_back = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 2.0], [0.0, 2.0]])
    cells = corridor(2.8)
    cells[np.ix_(abs(Y - 1.0) < 0.1, X < 6.5)] = OCCUPIED
    back = np.array([3.0, 1.9, np.pi])
    assert not rejoins(back, course(cells, there_and_back))
    assert rejoins(back, course(cells, there_and_back, 140))


@pytest.mark.parametrize(("x", "free"), [(4.5, False), (6.0, True)])
def test_four_metres_of_the_course_are_tested(x, free):
    blocked = corridor(1.0)
    blocked[:, abs(X - x) < 0.1] = OCCUPIED
    assert rejoins(np.array([1.0, 0.0, 0.0]), course(blocked)) == free


def test_the_end_of_a_path_is_all_that_is_asked_for():
    blocked = corridor(1.0)
    blocked[:, X > 2.5] = OCCUPIED
    short = np.array([[0.0, 0.0], [1.5, 0.0]])
    assert rejoins(np.array([0.5, 0.1, 0.0]), course(blocked, short))
    assert not rejoins(np.array([0.5, 0.1, 0.0]), course(blocked))


def test_a_manoeuvre_may_have_to_end_where_the_car_finds_back():
    state, limits = np.array([0.0, 0.0, 0.0, 2.0]), CAR.driving
    swerve, straight = np.full((2, 32, 2), -CAR.braking)
    swerve[:, 1], straight[:, 1] = 0.75, 0.0
    walls = course(corridor(1.0))
    risk = RiskMap.from_prediction(Grid(FRAME, corridor(1.0)), None, 0.0)
    scene, arcs = CHECKER.body_in(~risk.safe, FRAME), CHECKER.arcs_in(risk.barred, risk.frame)
    both = np.array([swerve, straight])
    assert first_free(state, both, 0.1, limits, 0.02, scene, EXACT, 0, arcs, walls) == 0
    assert first_free(state, both, 0.1, limits, 0.02, scene, EXACT, ON_COURSE, arcs, walls) == 1
    assert (
        first_free(state, both[:1], 0.1, limits, 0.02, scene, EXACT, ON_COURSE, arcs, walls) == -1
    )
