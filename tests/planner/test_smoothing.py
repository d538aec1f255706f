"""Paths made of lines: what they keep clear of, what they cost, and where they end."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rooms import CAR, Room, along, length

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from foresee.prediction import Prediction
from planner.guide.elastic_band import LineConfig, curvatures
from planner.guide.route import find_route
from planner.guide.smoothing import Smoother
from planner.motion.path import Path
from planner.risk.cost_map import UNKNOWN_COST, CostMap, remember

POSE, GOAL = (1.0, 3.0, 0.0), (11.0, 3.0)
FREELY = 0.45
"""So near to the start a body may be closer to something than it likes [m]."""


def smoother(room, pose=POSE, goal=GOAL) -> Smoother:
    return Smoother(room.cost, room.near(*pose[:2]), goal, CAR, LineConfig())


def smooth(room, pose=POSE, goal=GOAL, speed=2.0) -> Path | None:
    """The path of a car that knows a room, along its cheapest route; None: it has none."""
    route = find_route(room.cost, pose[:2], goal)
    if route is None:
        return None
    way = Path.through(route, "route").points
    return smoother(room, pose, goal).along(way, np.array(pose), "route")


@st.composite
def cluttered(draw):
    """A room of 12 m × 6 m with boxes in it, none near the start and the goal."""
    room = Room(12.0, 6.0)
    for _ in range(draw(st.integers(0, 7))):
        x, y = draw(st.floats(2.5, 9.0)), draw(st.floats(0.0, 5.5))
        width, height = draw(st.floats(0.1, 1.5)), draw(st.floats(0.1, 2.0))
        value = draw(st.sampled_from([OCCUPIED, OCCUPIED, UNKNOWN]))
        room.fill((x, x + width), (y, y + height), value)
    return room


@settings(max_examples=120)
@given(room=cluttered(), yaw=st.floats(-1.0, 1.0), speed=st.floats(0.0, 4.0))
def test_on_no_path_does_the_body_meet_what_was_seen_occupied(room, yaw, speed):
    path = smooth(room, (*POSE[:2], yaw), speed=speed)
    if path is None:
        return
    line = path.points[: path.drivable]
    # The points of a path lie on the chords of its line, and bend by a little more or less.
    assert np.abs(curvatures(line)).max() <= 1.1 * CAR.max_curvature
    poses = along(line)
    away = np.hypot(*(line - line[0]).T) >= FREELY
    assert not room.meets(poses[away])


def test_there_is_a_path_through_most_rooms():
    found = []

    @settings(max_examples=40, database=None)
    @given(room=cluttered())
    def search(room):
        if find_route(room.cost, POSE[:2], GOAL) is not None:
            found.append(smooth(room) is not None)

    search()
    assert np.mean(found) > 0.6


@pytest.mark.parametrize("speed", [0.0, 2.0, 4.0])
def test_a_path_that_crosses_what_was_not_seen_costs_more(speed):
    straight = Path.through(np.array([(1.0, 3.0), (11.0, 3.0)]), "")
    gaps = (0, 1, 2, 4)
    rooms = [Room(12.0, 6.0).fill((5.0, 5.0 + gap), (0.0, 6.0), UNKNOWN) for gap in gaps]
    prices = [smoother(room).price(straight, speed) for room in rooms]
    assert (np.diff(prices) > 0.9 * (UNKNOWN_COST - 1.0) * np.diff(gaps)).all()


@given(speed=st.floats(0.0, 4.0), radius=st.floats(0.8, 2.0), quarters=st.integers(1, 2))
def test_a_path_with_bends_costs_more_than_a_straight_one_of_its_length(speed, radius, quarters):
    room = Room(12.0, 12.0)
    angles = np.linspace(0.0, quarters * math.pi / 2, 40)
    bend = (5.0, 4.0) + radius * np.column_stack([np.sin(angles), 1.0 - np.cos(angles)])
    bent = Path.through(np.vstack([(1.5, 4.0), bend]), "")
    straight = Path.through(np.array([(1.5, 4.0), (1.5 + length(bent.points), 4.0)]), "")
    of = smoother(room, (1.5, 4.0, 0.0))
    assert of.price(bent, speed) > of.price(straight, speed)


def test_a_path_costs_a_fast_car_no_more_than_a_slow_one():
    room, straight = Room(12.0, 6.0), Path.through(np.array([(1.0, 3.0), (11.0, 3.0)]), "")
    prices = [smoother(room).price(straight, speed) for speed in (0.0, 1.0, 2.0, 4.0)]
    assert prices == sorted(prices, reverse=True)
    # At top speed all the way a metre is a metre.
    assert prices[-1] == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("behind", [1.2, 2.0, 4.0, 9.0])
def test_a_path_runs_on_past_the_goal_and_stops_before_a_wall(behind):
    room = Room(GOAL[0] + behind, 6.0)
    path = smooth(room)
    assert np.hypot(*(path.points - GOAL).T).min() < 0.1
    past = float(path.points[-1, 0]) - GOAL[0]
    full = CAR.stopping_distance + 0.5
    assert past < behind - CAR.body.half_width
    assert past == pytest.approx(min(full, behind - CAR.body.half_width - 0.22), abs=0.15)


def test_a_path_does_not_run_on_into_a_wall_that_is_believed_in():
    room = Room(20.0, 6.0).fill((11.5, 20.0), (0.0, 6.0), UNKNOWN)
    wall = np.zeros(room.frame.shape, np.float32)
    wall[:, (room.x > 13.5) & (room.x < 13.9)] = 1.0
    ends = []
    for word in (0 * wall, wall):
        believed = Prediction(room.frame, 1.0 - word, word, 0 * word + 0.9)
        belief = remember(None, room.frame, believed)
        cost = CostMap.build(room.known, belief, CAR.body.half_width)
        of = Smoother(cost, room.near(*POSE[:2]), GOAL, CAR, LineConfig())
        way = Path.through(np.array([POSE[:2], GOAL]), "").points
        ends.append(of.along(way, np.array(POSE), "").points[-1, 0])
    assert ends[0] == pytest.approx(GOAL[0] + CAR.stopping_distance + 0.5, abs=0.15)
    assert 12.5 < ends[1] < 13.5 - CAR.body.half_width


def test_a_path_begins_at_the_pose_and_is_spaced_evenly():
    path = smooth(Room(12.0, 6.0).fill((5.0, 5.5), (0.0, 3.6)))
    assert path.points[0] == pytest.approx(POSE[:2])
    steps = np.hypot(*np.diff(path.points, axis=0).T)
    assert steps == pytest.approx(steps[0], rel=0.02)
    assert 2 < path.drivable <= len(path.points)


def test_there_is_no_path_for_a_car_with_its_nose_in_a_dead_end():
    room = Room(12.0, 3.0).fill((0.0, 3.0), (2.0, 3.0)).fill((0.0, 3.0), (0.0, 1.0))
    assert find_route(room.cost, (0.6, 1.5), (11.0, 1.5)) is not None
    for turn in (0.0, 1e-9, 1e-4, 0.01, 0.1, -0.01, 0.5, -0.5):
        assert smooth(room, (0.6, 1.5, math.pi + turn), (11.0, 1.5)) is None
    assert smooth(room, (0.6, 1.5, 0.0), (11.0, 1.5)) is not None


def test_there_is_no_path_through_a_gap_narrower_than_the_body():
    room = Room(12.0, 6.0).fill((6.0, 6.2), (0.0, 2.9)).fill((6.0, 6.2), (3.1, 6.0))
    way = Path.through(np.array([POSE[:2], GOAL]), "").points
    assert smoother(room).along(way, np.array(POSE), "") is None
    wider = Room(12.0, 6.0).fill((6.0, 6.2), (0.0, 2.5)).fill((6.0, 6.2), (3.5, 6.0))
    assert smoother(wider).along(way, np.array(POSE), "") is not None


def test_there_is_no_path_round_a_bend_that_the_car_cannot_steer():
    # A corridor of half a metre with a right angle: the tightest arc does not fit.
    room = Room(6.0, 6.0, OCCUPIED).fill((0.0, 4.5), (1.0, 1.6), FREE)
    room.fill((3.9, 4.5), (1.0, 6.0), FREE)
    way = Path.through(np.array([(0.6, 1.3), (4.2, 1.3), (4.2, 5.5)]), "").points
    of = smoother(room, (0.6, 1.3, 0.0), (4.2, 5.5))
    assert of.along(way, np.array([0.6, 1.3, 0.0]), "") is None
