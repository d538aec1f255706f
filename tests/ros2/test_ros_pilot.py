"""The pilot drives, stops, and keeps the map from goal to goal."""

import math

import numpy as np
import pytest
from foresee_navigator.pilot import Mode, Pilot
from foresee_navigator.report import Circumstances, Severity, report_on
from foresee_navigator.stopping import stop_after

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE
from planner.motion.plan import Plan
from planner.navigator import NavigatorConfig
from sim import DubinsCar, Lidar, LidarConfig, empty_straight

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


def test_it_reaches_the_goal_and_stands():
    driver = pilot()
    states, action = drive(driver, START, 150)
    assert action.mode is Mode.REACHED
    for _ in range(20):
        action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    assert (action.speed, action.yaw_rate) == (0.0, 0.0)


def test_without_a_goal_it_stands_and_maps():
    driver = Pilot(NavigatorConfig(car=CAR), None, 0.05, 0.5)
    action = driver.act(START, LIDAR.scan(WORLD, START))
    assert (action.mode, action.speed) == (Mode.WAITING, 0.0)
    assert driver.known.whole().crop(driver.known.frame.square(5.0, 2.5, 0.5)).free.any()


def test_it_stops_as_hard_as_the_car_can_when_data_are_missing_and_goes_on_after():
    driver = pilot()
    states, action = drive(driver, START, 25)
    speeds = [action.speed]
    while speeds[-1] > 0.0:
        action = driver.stop()
        assert action.mode is Mode.STOPPED
        speeds.append(action.speed)
    losses = -np.diff(speeds)
    assert losses[:-1] == pytest.approx(CAR.braking * 0.1)
    assert len(speeds) < 20
    known = driver.known
    action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    assert action.mode is Mode.DRIVING
    assert driver.known is known


def test_a_new_goal_keeps_the_map_and_the_same_goal_changes_nothing():
    driver = pilot()
    states, _ = drive(driver, START, 20)
    seen = int((driver.known.cells == FREE).sum())
    assert not driver.head_for(GOAL)
    assert driver.head_for((12.0, 3.0))
    action = driver.act(states[-1], LIDAR.scan(WORLD, states[-1]))
    assert action.mode is Mode.DRIVING
    assert int((driver.known.cells == FREE).sum()) >= seen


def test_after_a_leap_the_map_is_new_and_the_goal_stays():
    driver = pilot()
    drive(driver, START, 10)
    driver.forget()
    assert driver.known is None
    there = np.array([8.0, 2.0, 0.3, 0.0])
    assert driver.act(there, LIDAR.scan(WORLD, there)).mode is Mode.DRIVING
    rows, cols = driver.known.frame.cell(3.0, 2.5)
    assert driver.known.cells[rows, cols] != FREE


def test_a_goal_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="it must be finite"):
        pilot().head_for((math.nan, 0.0))


def test_a_stop_without_a_last_resort_brakes_on_the_curve_of_the_plan():
    speeds = np.array([2.0, 2.0, 2.0, 1.85])
    plan = Plan(
        np.column_stack([np.zeros((4, 3)), speeds]), np.array([[0, 0.1], [0, 0.2], [0, 0.3]])
    )
    controls = stop_after(plan, None, 1.5)
    assert [c.curvature for c in controls[:3]] == [0.2, 0.2, 0.3]
    assert {c.acceleration for c in controls} == {-1.5}
    assert len(controls) == math.ceil(2.0 / 0.15)


def test_a_stop_with_a_last_resort_is_the_last_resort():
    plan = Plan(np.zeros((2, 4)), np.zeros((1, 2)))
    controls = stop_after(plan, np.array([[-1.5, 0.4], [-1.0, -0.2]]), 1.5)
    assert controls == [Control(-1.5, 0.4), Control(-1.0, -0.2)]


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
