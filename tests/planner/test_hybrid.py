"""The search over arcs: what it finds can be driven, in the gears that the car has."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from rooms import CAR, Room, wrapped

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from planner.guide.hybrid_astar import HybridConfig, find_legs
from planner.risk.cost_map import STUCK_REACH, CostMap

BOTH = dataclasses.replace(CAR, reverse=0.5)
"""A car with a reverse gear."""
CONFIG = HybridConfig()
NOWHERE = np.empty((0, 2))


def legs_of(room, pose, goal, car=BOTH, ahead=math.inf, stuck=NOWHERE, config=CONFIG):
    cost = CostMap.build(room.known, None, CAR.body.half_width, stuck=stuck)
    state = np.array([*pose, 0.0])
    return find_legs(cost, room.known, state, goal, ahead, stuck, car, config)


def arc(pose, gear, kappa, metres):
    """The pose that a car is at after some metres of an arc, from the arc's centre."""
    x, y, yaw = pose
    s = gear * metres
    if abs(kappa) < 1e-9:
        return np.array([x + s * math.cos(yaw), y + s * math.sin(yaw), yaw])
    end = yaw + kappa * s
    return np.array(
        [
            x + (math.sin(end) - math.sin(yaw)) / kappa,
            y - (math.cos(end) - math.cos(yaw)) / kappa,
            end,
        ]
    )


def driven(leg):
    """Curvature [1/m] and length [m] of each piece of a leg, from what it turns and its chord."""
    turn = wrapped(np.diff(leg.poses[:, 2]))
    chord = np.hypot(*np.diff(leg.poses[:, :2], axis=0).T)
    metres = chord * np.where(abs(turn) > 1e-9, 0.5 * turn / np.sin(0.5 * turn + 1e-300), 1.0)
    return leg.gear * turn / metres, metres


def swept(leg):
    """Poses every centimetre or so along a leg, (n, 3)."""
    poses = [leg.poses[0]]
    for pose, kappa, metres in zip(leg.poses[:-1], *driven(leg), strict=True):
        poses += [arc(pose, leg.gear, kappa, metres * i / 8) for i in range(1, 9)]
    return np.array(poses)


def check(room, legs, pose, car=BOTH, barred=None):
    """All that every way must satisfy, whatever the map."""
    seen_free = room.cells == FREE
    occupied = room.cells == OCCUPIED if barred is None else barred
    assert legs[0].poses[0] == pytest.approx(np.array(pose))
    for before, after in pairwise(legs):
        assert np.array_equal(before.poses[-1], after.poses[0])
        assert before.gear == -after.gear
    for leg in legs:
        assert leg.gear in ((1, -1) if car.reverse else (1,))
        kappas, metres = driven(leg)
        assert np.abs(kappas).max() <= car.max_curvature / CONFIG.slack + 1e-6
        assert metres.max() < 0.1
        for i, there in enumerate(leg.poses[1:]):
            end = arc(leg.poses[i], leg.gear, kappas[i], metres[i])
            assert end[:2] == pytest.approx(there[:2], abs=1e-6)
            assert float(wrapped(end[2] - there[2])) == pytest.approx(0.0, abs=1e-6)
        assert not room.meets(swept(leg), occupied if leg.gear > 0 else ~seen_free)


def pocket(width=1.6, depth=4.0, beyond=FREE):
    """A dead end that opens to the left into a hall: closed at the right, goal in the hall."""
    room = Room(10.0, 8.0, OCCUPIED).fill((0.0, 10.0 - depth), (0.0, 8.0), beyond)
    return room.fill((10.0 - depth - 0.1, 10.0), (4.0 - 0.5 * width, 4.0 + 0.5 * width), FREE)


NOSE_IN, IN_THE_HALL = (9.2, 4.0, 0.0), (2.0, 4.0)


@st.composite
def cluttered(draw):
    """A room of 8 m × 6 m with boxes, seen occupied or not seen, and a pose in it."""
    room = Room(8.0, 6.0)
    for _ in range(draw(st.integers(0, 8))):
        x, y = draw(st.floats(0.0, 6.5)), draw(st.floats(0.0, 5.0))
        width, height = draw(st.floats(0.1, 2.0)), draw(st.floats(0.1, 2.0))
        value = draw(st.sampled_from([OCCUPIED, UNKNOWN]))
        room.fill((x, x + width), (y, y + height), value)
    x, y, yaw = draw(st.floats(0.5, 7.5)), draw(st.floats(0.5, 5.5)), draw(st.floats(-3.1, 3.1))
    # A start may be close to something: what follows must not be.
    assume(not room.meets((x, y, yaw), room.cells != FREE, CAR.body.inflated(0.1)))
    return room, (x, y, yaw)


@settings(max_examples=30)
@given(cluttered(), st.sampled_from([CAR, BOTH]), st.sampled_from([3.0, math.inf]))
def test_every_way_can_be_driven_and_meets_nothing(drawn, car, ahead):
    room, pose = drawn
    goal = (7.2, 5.2)
    assume(room.cells[room.frame.cell(*goal)] != OCCUPIED)
    legs = legs_of(room, pose, goal, car, ahead)
    if legs:
        check(room, legs, pose, car)
        if ahead == math.inf:
            assert math.dist(legs[-1].poses[-1, :2], goal) < 0.3


def test_from_a_pocket_only_a_car_with_a_reverse_gear_gets_out():
    room = pocket()
    legs = legs_of(room, NOSE_IN, IN_THE_HALL)
    check(room, legs, NOSE_IN)
    assert legs[0].gear == -1
    assert math.dist(legs[-1].poses[-1, :2], IN_THE_HALL) < 0.3
    assert legs_of(room, NOSE_IN, IN_THE_HALL, CAR) == []


def test_a_way_in_both_gears_ends_forward_where_it_is_to_lead_on():
    legs = legs_of(pocket(), NOSE_IN, IN_THE_HALL, ahead=5.0)
    assert [leg.gear for leg in legs][:1] == [-1]
    assert legs[-1].gear == 1


def test_in_reverse_the_car_keeps_out_of_what_it_has_not_seen():
    # Behind the pocket only a strip beside its mouth has been seen.
    room = pocket(beyond=UNKNOWN).fill((3.5, 6.0), (2.2, 5.8), FREE)
    legs = legs_of(room, NOSE_IN, IN_THE_HALL)
    check(room, legs, NOSE_IN)
    # Forward it may go on into the unseen.
    assert legs[-1].gear == 1
    assert room.meets(swept(legs[-1]), room.cells == UNKNOWN)
    # In a pocket too narrow to turn in there is no way out of it but backwards.
    narrow = pocket(width=0.6, beyond=UNKNOWN)
    assert legs_of(narrow, NOSE_IN, IN_THE_HALL) == []
    assert legs_of(pocket(width=0.6), NOSE_IN, IN_THE_HALL)[0].gear == -1


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi / 2, math.pi])
def test_in_a_room_of_four_metres_a_car_turns_round(yaw):
    # The only way out is behind a car that looks along x, through a door at the left.
    room = Room(10.0, 4.0, OCCUPIED).fill((6.0, 10.0), (0.0, 4.0), FREE)
    room.fill((0.0, 6.1), (1.3, 2.7), FREE)
    start, goal = (8.0, 2.0, yaw), (1.0, 2.0)
    for car in (CAR, BOTH):
        legs = legs_of(room, start, goal, car)
        assert legs
        check(room, legs, start, car)
        assert math.dist(legs[-1].poses[-1, :2], goal) < 0.3


def test_where_the_car_can_simply_go_on_it_does_not_reverse():
    legs = legs_of(Room(12.0, 4.0), (2.0, 2.0, 0.0), (10.0, 2.0))
    assert [leg.gear for leg in legs] == [1]
    assert np.abs(legs[0].poses[:, 1] - 2.0).max() < 0.3


def test_there_is_nothing_where_the_goal_is_walled_in():
    room = Room(4.0, 2.5).fill((2.2, 4.0), (0.0, 2.5)).fill((2.6, 3.8), (0.5, 2.0), FREE)
    for goal in [(3.2, 1.25), (2.3, 1.25), (20.0, 1.25)]:
        assert legs_of(room, (1.0, 1.25, 0.0), goal) == []


def test_there_is_nothing_for_a_car_that_is_walled_in_itself():
    room = Room(8.0, 6.0).fill((1.0, 3.0), (2.0, 4.0)).fill((1.5, 2.5), (2.5, 3.5), FREE)
    assert legs_of(room, (2.0, 3.0, 0.0), (7.0, 3.0)) == []


def test_the_same_input_gives_the_same_legs():
    first, second = (legs_of(pocket(), NOSE_IN, IN_THE_HALL) for _ in range(2))
    assert [leg.gear for leg in first] == [leg.gear for leg in second]
    for one, other in zip(first, second, strict=True):
        assert np.array_equal(one.poses, other.poses)


def test_the_map_is_not_changed_by_a_search():
    room = pocket(beyond=UNKNOWN)
    known, stuck = room.known, np.array([[6.0, 4.0]])
    before = known.log_odds.copy()
    cost = CostMap.build(known, None, CAR.body.half_width, stuck=stuck)
    density = cost.density.copy()
    find_legs(cost, known, np.array([*NOSE_IN, 0.0]), IN_THE_HALL, 6.0, stuck, BOTH, CONFIG)
    assert np.array_equal(known.log_odds, before)
    assert np.array_equal(cost.density, density)


def test_around_a_place_where_the_car_was_stuck_it_keeps_out_of_the_unseen():
    # A wall with two gaps, not seen: one straight ahead, one at the top.
    room = Room(10.0, 8.0).fill((5.0, 6.0), (0.0, 8.0))
    room.fill((5.0, 6.0), (1.0, 3.0), UNKNOWN).fill((5.0, 6.0), (6.0, 7.5), UNKNOWN)
    start, goal, place = (2.0, 2.0, 0.0), (9.0, 2.0), (5.2, 2.0)
    plain = legs_of(room, start, goal, CAR)
    kept = legs_of(room, start, goal, CAR, stuck=np.array([place]))
    near = (abs(room.x - place[0]) < STUCK_REACH) & (abs(room.y[:, None] - place[1]) < STUCK_REACH)
    barred = (room.cells == OCCUPIED) | (near & (room.cells == UNKNOWN))
    assert room.meets(swept(plain[0]), barred)
    check(room, kept, start, CAR, barred)
    assert kept[0].poses[:, 1].max() > 6.0


def test_a_search_gives_up_after_as_many_places_as_it_is_told():
    few = dataclasses.replace(CONFIG, nodes=5)
    assert legs_of(pocket(), NOSE_IN, IN_THE_HALL, config=few) == []
