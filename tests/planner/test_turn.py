"""Turns on the spot: where to, only where all of the turn is observed free, and in closed loop."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rooms import Room
from short_drive import LIDAR

from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from planner.fault import Fault
from planner.guide.turn import TURNED, angle_to, can_turn, rate_towards
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from sim import DubinsCar, Task
from sim.episode import EpisodeConfig, Outcome, run_episode

CAR = CarLimits(reverse=0.5, turn_rate=1.5)
angles = st.floats(-math.pi, math.pi)


@given(angles, angles)
def test_the_angle_to_a_straight_route_is_the_shorter_one(yaw, direction):
    line = np.linspace(0.0, 3.0, 31)[:, None] * [math.cos(direction), math.sin(direction)]
    angle = angle_to(line, np.array([0.0, 0.0, yaw]))
    assert abs(angle) <= math.pi
    assert math.cos(yaw + angle - direction) == pytest.approx(1.0)


def test_a_route_is_looked_at_a_metre_ahead_or_at_its_end():
    corner = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 3.0]])
    assert angle_to(corner, np.zeros(3)) == pytest.approx(math.atan2(3.0, 0.4))
    assert angle_to(corner[:2], np.zeros(3)) == 0.0


@settings(max_examples=40)
@given(st.integers(0, 2**32), angles, angles)
def test_a_turn_that_is_allowed_meets_no_cell_that_was_not_observed_free(seed, yaw, angle):
    rng = np.random.default_rng(seed)
    room = Room(4.0, 4.0)
    for x, y in rng.uniform(1.5, 2.5, (4, 2)):
        value = OCCUPIED if rng.random() < 0.5 else UNKNOWN
        room.fill((x, x + 0.1), (y, y + 0.1), value)
    pose = np.array([2.0, 2.0, yaw])
    if can_turn(pose, angle, room.near(2.0, 2.0), CAR):
        poses = np.tile(pose, (2000, 1))
        poses[:, 2] += np.linspace(0.0, angle, 2000)
        assert not room.meets(poses, room.cells != FREE)
        # A part of it is then allowed as well.
        assert can_turn(pose, 0.5 * angle, room.near(2.0, 2.0), CAR)


@pytest.mark.parametrize("value", [OCCUPIED, UNKNOWN])
def test_a_cell_between_the_first_and_the_last_yaw_forbids_the_turn(value):
    room = Room(4.0, 4.0).fill((2.1, 2.15), (2.2, 2.25), value)
    pose, risk = np.array([2.0, 2.0, 0.0]), room.near(2.0, 2.0)
    assert not can_turn(pose, math.pi, risk, CAR)
    assert can_turn(pose, 0.1, risk, CAR)
    assert can_turn(pose, math.pi, Room(4.0, 4.0).near(2.0, 2.0), CAR)


@given(angles, angles)
def test_a_turn_ends_at_its_yaw_after_the_least_number_of_ticks(yaw, to):
    risk, state, ticks = Room(4.0, 4.0).near(2.0, 2.0), np.array([2.0, 2.0, yaw, 0.0]), 0
    left = abs(math.remainder(to - yaw, 2 * math.pi))
    while (rate := rate_towards(to, state, risk, CAR)) != 0.0:
        assert abs(rate) <= CAR.turn_rate
        state[2] += 0.1 * rate
        ticks += 1
    assert abs(math.remainder(to - state[2], 2 * math.pi)) <= TURNED
    assert ticks <= math.ceil(left / 0.15)


def test_a_turn_ends_if_the_car_moves_or_the_rest_is_no_longer_free():
    state, free = np.array([2.0, 2.0, 0.0, 0.0]), Room(4.0, 4.0)
    assert rate_towards(1.5, state, free.near(2.0, 2.0), CAR) == CAR.turn_rate
    moving = np.array([2.0, 2.0, 0.0, 0.1])
    assert rate_towards(1.5, moving, free.near(2.0, 2.0), CAR) == 0.0
    blocked = free.fill((2.1, 2.15), (2.2, 2.25))
    assert rate_towards(1.5, state, blocked.near(2.0, 2.0), CAR) == 0.0


def driven(room, start, goal, car=CAR):
    """The episode of a car that knows nothing at the start; and whether each turn was observed."""
    task = Task(room.world, start, goal, np.array([goal]), math.dist(start[:2], goal), 0)
    config = NavigatorConfig(car=car)
    known = OccupancyGrid(room.frame, config.window)
    known_start = min(config.start_margin, task.start_margin(car.body))
    config = NavigatorConfig(car=car, start_margin=known_start)
    driver = Navigator(config, None, np.array(start), goal, known, seed=0)
    decide, observed = driver.step, []

    def step(state, scan):
        decision = decide(state, scan)
        if decision.control.turn_rate:
            assert (np.ptp(decision.plan.states, axis=0) == 0.0).all()
            poses = np.tile(state[:3], (200, 1))
            poses[:, 2] += np.linspace(0.0, 0.1 * decision.control.turn_rate, 200)
            blocked = known.cells != FREE
            scene = Scene(blocked, *known.frame.lattice, *car.body.halves)
            observed.append(first_contact(scene, poses) < 0)
        return decision

    driver.step = step
    rng = np.random.default_rng(0)
    return run_episode(task, driver, DubinsCar(car), LIDAR, EpisodeConfig(), rng), observed


def test_a_car_that_starts_with_its_back_to_the_goal_turns_and_drives_there():
    room = Room(14.0, 2.0)
    episode, observed = driven(room, (10.0, 1.0, 0.3), (2.0, 1.0))
    assert episode.outcome == Outcome.REACHED
    assert episode.paths["turn"] == 1
    # About 160° at 1.5 rad/s.
    assert 15 <= len(observed) <= 25
    assert all(observed)
    straight, _ = driven(room, (10.0, 1.0, 0.3), (2.0, 1.0), CarLimits(reverse=0.5))
    assert "turn" not in straight.paths
    assert episode.time < straight.time


def test_a_car_without_room_to_turn_backs_out_first():
    # Between walls 0.4 m apart, a body with a diagonal of 0.58 m cannot turn.
    room = Room(8.0, 4.0, OCCUPIED).fill((0.0, 4.0), (0.0, 4.0), FREE)
    room.fill((3.9, 6.0), (1.8, 2.2), FREE)
    episode, observed = driven(room, (5.3, 2.0, 0.0), (1.0, 3.0))
    assert episode.outcome != Outcome.COLLIDED
    assert all(observed)
    x, y, yaw, _ = episode.trace["states"].T
    turned = np.abs(np.diff(yaw)) > 1e-9
    in_place = np.hypot(np.diff(x), np.diff(y)) < 1e-9
    assert not (turned & in_place & (x[:-1] > 4.2)).any()


def test_a_turn_of_a_car_that_does_not_obey_ends_with_a_fault():
    room, state = Room(14.0, 3.0), np.array([10.0, 1.5, 0.0, 0.0])
    config = NavigatorConfig(car=CAR)
    known = OccupancyGrid(room.frame, config.window)
    driver = Navigator(config, None, state[:3], (2.0, 1.5), known, seed=0)
    scan = LIDAR.scan(room.world, state)
    turns = [bool(driver.step(state, scan).control.turn_rate) for _ in range(80)]
    assert turns[0]
    # A half turn takes 2.1 s, so the turn is given up after 5.2 s.
    assert turns.index(False) == 52
    assert driver.faults[Fault.TURN_FAILED] == 1


def test_a_dead_end_is_left_by_turning():
    room = Room(14.0, 8.0, OCCUPIED).fill((0.0, 5.0), (0.0, 8.0), FREE)
    room.fill((4.9, 9.0), (1.2, 2.8), FREE)
    room.fill((4.9, 14.0), (6.0, 8.0), FREE).fill((10.0, 14.0), (0.0, 8.0), FREE)
    episode, observed = driven(room, (1.5, 2.0, 0.0), (12.0, 2.0))
    assert episode.outcome == Outcome.REACHED
    assert all(observed)


def test_other_cars_never_turn_on_the_spot():
    _, observed = driven(Room(14.0, 3.0), (10.0, 1.5, 0.3), (2.0, 1.5), CarLimits(reverse=0.5))
    assert observed == []
