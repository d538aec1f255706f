"""The pilot drives, stops, and keeps the map from goal to goal."""

import math
from collections import deque

import numpy as np
import pytest
from foresee_navigator.pilot import Mode, Pilot
from foresee_navigator.report import Circumstances, Severity, report_on
from foresee_navigator.settings import NavigatorSettings, SimulatorSettings
from foresee_navigator.simulated_robot import STEP, SimulatedRobot, task_for
from scipy.ndimage import binary_dilation

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.commands import TwistCommand
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, UNKNOWN, Grid
from planner.navigator_config import NavigatorConfig
from sim import DubinsCar, Lidar, LidarConfig, Task, empty_straight, save_world
from sim.world import World

CAR = CarLimits(v_max=2.0)
WORLD, LIDAR = empty_straight(20.0, 4.0), Lidar(LidarConfig(beams=271))
START, GOAL = np.array([3.0, 2.5, 0.0, 0.0]), (15.0, 2.5)


def pilot():
    made = Pilot(NavigatorConfig(car=CAR), None, 0.05, 0.5)
    made.head_for(GOAL)
    return made


def drive(driver, state, ticks):
    """Drive with an exact car; return the states and the last action."""
    states, car = [state], DubinsCar(CAR)
    for _ in range(ticks):
        action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
        states.append(car.step(states[-1], follow(states[-1], action), 0.1))
        if action.mode is not Mode.DRIVING:
            break
    return states, action


def follow(state, action):
    curvature = action.yaw_rate / action.speed if action.speed else 0.0
    return Control((action.speed - float(state[3])) / 0.1, curvature)


def test_a_car_that_stands_sets_off_whatever_noise_its_speed_is_measured_with():
    driver, state = pilot(), START.copy()
    for noise in (-0.001, 0.004, -0.009):
        state[3] = noise
        action = driver.act(state, LIDAR.scan(WORLD, state))
        assert action.speed > 0.1


def test_it_reaches_the_goal_and_stands():
    driver = pilot()
    states, action = drive(driver, START, 150)
    assert action.mode is Mode.REACHED
    for _ in range(20):
        action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    assert (action.speed, action.yaw_rate) == (0.0, 0.0)


def test_the_simulated_robot_turns_on_the_spot_only_where_it_can():
    start, goal = (10.0, 2.5, 0.0), (3.0, 2.5)
    task = Task(WORLD, start, goal, np.array([goal]), 7.0, 0)
    yaws = []
    for name in ("jackal", "f1tenth"):
        robot = SimulatedRobot(SimulatorSettings(robot=name), task)
        robot.command(0.0, 1.0)
        robot.step()
        yaws.append(robot.state[2])
    assert yaws == pytest.approx([STEP, 0.0])


@pytest.mark.parametrize("delay", [0.1, 0.3])
def test_a_robot_whose_commands_act_late_stops_before_a_wall(delay):
    config = NavigatorSettings(v_max=3.0, delay=delay, jitter=0.0).navigator
    goal = (11.6, 1.1)
    task = Task(empty_straight(12.0, 1.2), (2.0, 1.1, 0.0), goal, np.array([goal]), 9.6, 0)
    robot = SimulatedRobot(SimulatorSettings(v_max=3.0, range_noise=0.0), task)
    driver, speeds, sent = Pilot(config, None, 0.05, 0.05), [], deque()
    driver.head_for(goal)
    for _ in range(80):
        action = driver.act(robot.state.copy(), robot.scan())
        sent.append((robot.time + delay, action))
        assert action.decision is None or not action.decision.faults
        for _ in range(5):
            if sent and sent[0][0] < robot.time + 0.5 * STEP:
                _, acting = sent.popleft()
                robot.command(acting.speed, acting.yaw_rate)
            robot.step()
            speeds.append(float(robot.state[3]))
    assert max(speeds) > 1.5
    # It brakes as hard as is planned, not half as hard.
    assert min(b - a for a, b in zip(speeds, speeds[5:], strict=False)) < -0.12
    assert not robot.has_collided
    assert all(action.speed == 0.0 or speeds[-1] > 0.0 for _, action in sent)


def test_the_commands_that_are_kept_stop_a_robot_whose_commands_act_late():
    config = NavigatorSettings(delay=0.2, jitter=0.0).navigator
    driver, state = Pilot(config, None, 0.05, 0.5), START.copy()
    driver.head_for(GOAL)
    for _ in range(12):
        action = driver.act(state, LIDAR.scan(WORLD, state))
        state = DubinsCar(CAR).step(state, follow(state, action), 0.1)
    assert driver.coming(float(state[3]))[-1].speed == pytest.approx(0.0, abs=1e-6)


def test_a_turn_on_the_spot_ends_if_no_decision_follows():
    settings = NavigatorSettings(robot="jackal", range_error=0.0, delay=0.0, jitter=0.0)
    driver = Pilot(settings.navigator, None, 0.05, 0.5)
    driver.head_for((3.0, 2.5))
    state = np.array([12.0, 2.5, 0.0, 0.0])
    while (action := driver.act(state, LIDAR.scan(WORLD, state))).yaw_rate == 0.0:
        pass
    assert action.speed == 0.0
    assert driver.coming(0.0)[0] == TwistCommand(0.0, 0.0)


def test_without_a_goal_it_stands_and_maps():
    driver = Pilot(NavigatorConfig(car=CAR), None, 0.05, 0.5)
    action = driver.act(START, LIDAR.scan(WORLD, START))
    assert (action.mode, action.speed) == (Mode.WAITING, 0.0)
    assert driver.known.whole().crop(driver.known.frame.square(5.0, 2.5, 0.5)).free.any()


def stopped(driver, state, begin):
    """Let the car stop by a function of the pilot; return the states."""
    states, car = [state], DubinsCar(CAR)
    while states[-1][3] > 0.0:
        states.append(car.step(states[-1], follow(states[-1], begin()), 0.1))
        assert len(states) < 60
    return states


def test_without_data_it_stops_by_the_manoeuvre_that_was_kept_and_goes_on_after():
    driver = pilot()
    states, action = drive(driver, START, 25)
    kept = action.decision.last_resort[1:]
    coming = driver.coming(float(states[-1][3]))
    actions = []

    def missing():
        actions.append(driver.stop())
        return actions[-1]

    stop = stopped(driver, states[-1], missing)
    assert {a.mode for a in actions} == {Mode.STOPPED}
    assert [a.speed for a in actions[: len(coming)]] == [c.speed for c in coming[: len(actions)]]
    assert actions[0].speed - float(states[-1][3]) == pytest.approx(0.1 * kept[0, 0], abs=1e-6)
    assert (driver.stop().speed, driver.stop().yaw_rate) == (0.0, 0.0)
    assert driver.coming(0.0) == []
    known = driver.known
    there = stop[-1]
    action = driver.act(there, LIDAR.scan(WORLD, there))
    assert action.mode is Mode.DRIVING
    assert driver.known is known


@pytest.mark.parametrize("ticks", [5, 20])
def test_a_late_decision_is_withdrawn_and_what_was_kept_is_driven(ticks):
    driver, on_time = pilot(), pilot()
    states, _ = drive(driver, START, ticks)
    drive(on_time, START, ticks)
    coming = driver.coming(float(states[-1][3]))
    driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    action = driver.late(2)
    assert action.mode is Mode.LATE
    assert (action.speed, action.yaw_rate) == (coming[1].speed, coming[1].yaw_rate)
    assert [on_time.stop().speed for _ in range(2)] == [c.speed for c in coming[:2]]
    # From there on, both are in the same situation.
    later = DubinsCar(CAR).step(states[-1], Control(0.0, 0.0), 0.2)
    ways = [p.act(later, LIDAR.scan(WORLD, later)).speed for p in (driver, on_time)]
    assert ways[0] == pytest.approx(ways[1], abs=0.05)


def test_a_late_tick_without_a_decision_is_driven_as_one_in_time():
    drivers = pilot(), pilot()
    for driver in drivers:
        states, _ = drive(driver, START, 20)
        driver._has_reached = True
    coming = drivers[0].coming(float(states[-1][3]))
    for driver in drivers:
        assert driver.act(states[-1], LIDAR.scan(WORLD, states[-1])).mode is Mode.REACHED
    drivers[1].stop()
    action = drivers[0].late(2)
    assert (action.speed, action.yaw_rate) == (coming[1].speed, coming[1].yaw_rate)
    kept = [driver._navigator.chooser.kept for driver in drivers]
    assert np.array_equal(*kept)


def test_a_new_goal_on_the_drive_keeps_the_map_and_what_was_sent_and_the_same_changes_nothing():
    driver = pilot()
    states, _ = drive(driver, START, 20)
    seen = int((driver.known.cells == FREE).sum())
    assert not driver.head_for(GOAL)
    navigator = driver._navigator
    assert driver.head_for((12.0, 3.0))
    action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    assert action.mode is Mode.DRIVING
    assert driver._navigator is navigator
    assert action.speed > float(states[-1][3]) - 0.1
    assert int((driver.known.cells == FREE).sum()) >= seen
    states, action = drive(driver, states[-1], 150)
    assert action.mode is Mode.REACHED
    assert math.dist(states[-1][:2], (12.0, 3.0)) < 0.6


def test_a_car_that_rolls_when_its_map_begins_stops_first():
    driver = pilot()
    rolling = np.array([3.0, 2.5, 0.0, 1.0])
    action = driver.act(rolling, LIDAR.scan(WORLD, rolling))
    assert (action.mode, action.speed) == (Mode.STOPPED, pytest.approx(0.85))
    assert report_on(action, Circumstances()).message == "stops: it rolled when the map began"
    # The space around it counts as free where it stands.
    assert driver.known is None
    standing = np.array([3.4, 2.5, 0.0, 0.0])
    assert driver.act(standing, LIDAR.scan(WORLD, standing)).mode is Mode.DRIVING


def test_after_a_leap_the_map_is_new_and_the_goal_stays():
    driver = pilot()
    drive(driver, START, 10)
    driver.forget()
    assert driver.known is None
    there = np.array([8.0, 2.0, 0.3, 0.0])
    assert driver.act(there, LIDAR.scan(WORLD, there)).mode is Mode.DRIVING
    rows, cols = driver.known.frame.cell(3.0, 2.5)
    assert driver.known.cells[rows, cols] != FREE


def test_the_simulator_seals_the_map_that_it_reads(tmp_path):
    # One unknown cell before each wall, as robots map it.
    grid = WORLD.grid
    cells = np.where(binary_dilation(grid.occupied) & grid.free, UNKNOWN, grid.cells)
    save_world(World("slivers", Grid(grid.frame, cells.astype(np.int8))), tmp_path / "map.yaml")
    settings = SimulatorSettings(world=str(tmp_path / "map.yaml"), seed=1, length=8.0)
    task = task_for(settings)
    assert np.isfinite(LIDAR.scan(task.world, task.start).ranges).any()


def test_a_goal_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="it must be finite"):
        pilot().head_for((math.nan, 0.0))


def test_a_goal_that_is_too_far_away_is_refused():
    driver, far = pilot(), (4e5, 5.6e6)
    drive(driver, START, 2)
    with pytest.raises(ValueError, match="cells"):
        driver.head_for(far)
    assert driver.goal == GOAL
    without = Pilot(NavigatorConfig(car=CAR), None, 0.05, 0.5)
    without.head_for(far)
    action = without.act(START, LIDAR.scan(WORLD, START))
    assert (action.mode, action.speed, without.goal) == (Mode.WAITING, 0.0, None)
    assert "cells" in action.refused
    without.head_for(GOAL)
    assert without.act(START, LIDAR.scan(WORLD, START)).mode is Mode.DRIVING


def test_a_report_says_why_the_car_is_slow():
    driver = pilot()
    _, action = drive(driver, START, 1)
    report = report_on(action, Circumstances(duration=0.02))
    assert report.severity is Severity.OK
    assert report.values["limit"] == str(action.decision.limit)
    assert report.message == f"drives, limited by {action.decision.limit}"
    late = report_on(action, Circumstances(duration=0.25))
    assert late.severity is Severity.WARN
    assert late.values["late"] == "yes"
    lost = report_on(driver.stop(), Circumstances(("no scan for 0.6 s",)))
    assert lost.severity is Severity.ERROR
    assert lost.message == "stops: no scan for 0.6 s"
