"""Controls that were sent and act later: what the planner makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from short_drive import LIDAR, straight

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.error_bounds import ErrorBounds
from planner.motion.path import Path
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from planner.safety.sent_controls import SentControls

CAR = CarLimits()
BRAKE = Control(-CAR.braking, 0.0)
BOUNDS = ErrorBounds(delay=0.2, jitter=0.05, lag=0.1)


def ticks_until_it_holds(sent: SentControls) -> int:
    for ticks in range(100):
        if sent.holds:
            return ticks
        sent.add(BRAKE)
    raise AssertionError("it never holds")


@pytest.mark.parametrize("bounds", [BOUNDS, replace(BOUNDS, lag=0.0)])
def test_a_car_holds_once_nothing_that_may_still_act_accelerates(bounds):
    sent = SentControls(CAR, bounds, 0.1)
    assert sent.holds
    sent.add(Control(1.5, 0.0))
    ticks = ticks_until_it_holds(sent)
    assert 0.1 * ticks >= bounds.delay + bounds.jitter + bounds.lag
    assert ticks < 10


def test_a_car_without_errors_holds_as_soon_as_it_stands():
    sent = SentControls(CAR, ErrorBounds(), 0.1)
    sent.add(Control(1.5, 0.0))
    assert sent.holds


def test_the_gear_changes_only_when_nothing_that_was_sent_can_move_the_car():
    task = straight()
    config = NavigatorConfig(car=replace(CAR, reverse=1.0), bounds=BOUNDS)
    start = np.array([*task.start, 0.0])
    driver = Navigator(config, None, start, task.goal, task.blank(5.0), seed=task.seed)
    scan = LIDAR.scan(task.world, start, np.random.default_rng(0))
    driver.step(start, scan)
    # What was sent last moves the car a little, after which it stands again.
    driver.withdraw()
    driver.chooser.forget()
    sent = driver._sent
    sent.add(Control(1.5, 0.0))
    sent.add(BRAKE)
    back = Path.through(np.array([[2.0, 2.0], [1.7, 2.0]]), "hybrid")
    driver.guide._legs = [(-1, back), (1, back)]
    while not sent.holds:
        control = driver.step(start, scan).control
        assert control.gear == 1 or sent.holds
        assert control.acceleration < 0.0 or sent.holds
    assert driver.step(start, scan).control.gear == -1
