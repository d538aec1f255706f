"""New goals while the car drives."""

import math

import numpy as np
import pytest
from short_drive import LIDAR, navigator, straight

from foresee.mapping.error_bounds import ErrorBounds
from sim import DubinsCar


def driven(driver, task, state, ticks):
    """Drive for some ticks, and return the last state and decision."""
    for _ in range(ticks):
        decision = driver.step(state, LIDAR.scan(task.world, state))
        state = DubinsCar().step(state, decision.control, 0.1)
    return state, decision


def test_a_new_goal_on_the_drive_leaves_what_keeps_the_car_safe():
    task = straight()
    driver = navigator(task, bounds=ErrorBounds(delay=0.1))
    state, _ = driven(driver, task, np.array([*task.start, 0.0]), 12)
    sent, kept = driver._sent, driver.chooser.kept
    assert state[3] > 1.0
    driver.head_for((12.0, 3.0))
    assert driver._sent is sent
    assert np.array_equal(driver.chooser.kept, kept)
    state, decision = driven(driver, task, state, 1)
    assert decision.path is not None
    assert np.hypot(*(decision.path.points - [12.0, 3.0]).T).min() < 0.3
    assert not decision.emergency
    assert state[3] > 1.0
    state, _ = driven(driver, task, state, 60)
    assert math.dist(state[:2], (12.0, 3.0)) < 0.6


def test_a_decision_can_be_withdrawn_after_a_new_goal():
    task = straight()
    driver = navigator(task)
    state, _ = driven(driver, task, np.array([*task.start, 0.0]), 10)
    driver.head_for((11.0, 2.5))
    driven(driver, task, state, 1)
    driver.withdraw()
    driver.skip()
    assert {chooser.goal for chooser in driver._choosers.values()} == {(11.0, 2.5)}


@pytest.mark.parametrize("goal", [(math.nan, 0.0), (0.0, math.inf)])
def test_a_new_goal_that_is_not_finite_is_refused(goal):
    with pytest.raises(ValueError, match="finite"):
        navigator(straight()).head_for(goal)


def test_a_refused_goal_leaves_the_goal_that_the_car_has():
    task = straight()
    driver = navigator(task)
    guide = driver.guide
    with pytest.raises(ValueError, match="is the pose in the frame"):
        driver.head_for((1e7, 1e7))
    assert (driver.goal, driver.guide) == (task.goal, guide)
