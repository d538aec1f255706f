"""The shortest way is that of a disc, pulled taut; nothing drives quicker than its bound."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.optimal.shortest_path import NoPathError, path_length, shortest_path, time_bound
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from sim.buildings import task_in
from sim.families import empty_straight
from sim.world import World

CAR = CarLimits()
RADIUS = CAR.body.half_width


def room(*boxes, size=(8.0, 6.0), resolution=0.05):
    """A room with boxes (x0, y0, x1, y1) in it [m]."""
    shape = (round(size[1] / resolution), round(size[0] / resolution))
    frame = GridFrame(resolution, (0.0, 0.0), shape)
    xs, ys = frame.centres()
    cells = np.full(shape, FREE, dtype=np.int8)
    for x0, y0, x1, y1 in boxes:
        cells[np.ix_((ys > y0) & (ys < y1), (xs > x0) & (xs < x1))] = OCCUPIED
    return World("room", Grid(frame, cells))


def around(start, goal, corner):
    """Length of the taut way around one circle at a corner [m]."""
    total, turn = 0.0, 0.0
    to = [np.subtract(end, corner) for end in (start, goal)]
    for end in to:
        far = math.hypot(*end)
        total += math.sqrt(max(0.0, far**2 - RADIUS**2))
        turn += math.acos(min(1.0, RADIUS / far))
    between = math.acos(float(to[0] @ to[1]) / math.hypot(*to[0]) / math.hypot(*to[1]))
    return total + RADIUS * (between - turn)


def test_in_an_empty_room_the_way_is_straight():
    way = shortest_path(room(), (0.61, 0.52), (7.33, 5.17), RADIUS)
    assert way.tolist() == [[0.61, 0.52], [7.33, 5.17]]


def test_around_a_wall_the_way_is_tangents_and_arcs():
    start, goal, world = (1.0, 1.0), (7.0, 1.5), room((3.0, 0.0, 4.0, 4.0))
    way = shortest_path(world, start, goal, RADIUS)
    above = 4.0 + RADIUS
    left = around(start, (3.0, above), (3.0, 4.0))
    right = around((4.0, above), goal, (4.0, 4.0))
    assert path_length(way) == pytest.approx(left + 1.0 + right, abs=1e-3)


def test_the_way_takes_the_shorter_side():
    world = room((3.0, 1.0, 4.0, 4.8))
    below = shortest_path(world, (1.0, 2.0), (6.0, 2.0), RADIUS)
    above = shortest_path(world, (1.0, 4.0), (6.0, 4.0), RADIUS)
    assert below[:, 1].min() < 1.0
    assert above[:, 1].max() > 4.8


def test_the_way_is_no_shorter_than_the_straight_line_and_no_longer_than_the_tasks():
    for seed in (0, 2):
        task = task_in("corridor", seed)
        length = path_length(shortest_path(task.world, task.start[:2], task.goal, RADIUS))
        straight = math.dist(task.start[:2], task.goal)
        assert straight - 1e-9 <= length <= task.path_length + 1e-6


def test_the_way_is_the_same_length_backwards():
    task = task_in("trap", 2)
    there = shortest_path(task.world, task.start[:2], task.goal, RADIUS)
    back = shortest_path(task.world, task.goal, task.start[:2], RADIUS)
    assert path_length(there) == pytest.approx(path_length(back), abs=2e-3)


def test_a_gap_narrower_than_the_disc_is_no_way():
    apart = room((3.0, 0.0, 4.0, 2.9), (3.0, 3.1, 4.0, 6.0))
    with pytest.raises(NoPathError, match="no path for a disc"):
        shortest_path(apart, (1.0, 3.0), (6.0, 3.0), RADIUS)
    assert len(shortest_path(apart, (1.0, 3.0), (6.0, 3.0), 0.07)) == 2


def test_what_cannot_be_asked_for_is_named():
    with pytest.raises(NoPathError, match="does not fit at the goal"):
        shortest_path(room(), (1.0, 1.0), (7.99, 1.0), RADIUS)
    with pytest.raises(ValueError, match="radius is nan m"):
        shortest_path(room(), (1.0, 1.0), (7.0, 1.0), math.nan)


@given(st.floats(0.0, 100.0), st.floats(0.1, 50.0))
def test_the_bound_grows_with_the_way_and_is_never_below_top_speed(length, more):
    time = time_bound(length, CAR, 0.5)
    assert time >= max(0.0, length - 0.5) / CAR.v_max
    assert time_bound(length + more, CAR, 0.5) >= time
    assert time_bound(length, CarLimits(v_max=5.0), 0.5) <= time


def test_the_bound_is_that_of_accelerating_and_then_top_speed():
    # 4 m/s after 2.667 s and 5.333 m.
    assert time_bound(0.5 + 16.0 / 3.0, CAR, 0.5) == pytest.approx(8.0 / 3.0)
    assert time_bound(0.5 + 16.0 / 3.0 + 8.0, CAR, 0.5) == pytest.approx(8.0 / 3.0 + 2.0)
    assert time_bound(0.5 + 0.75, CAR, 0.5) == pytest.approx(1.0)
    assert time_bound(0.3, CAR, 0.5) == 0.0


def test_a_straight_corridor_is_driven_along_its_axis():
    world = empty_straight(20.0, 2.0)
    assert path_length(shortest_path(world, (2.0, 1.5), (18.0, 1.5), RADIUS)) == pytest.approx(16.0)
