"""Drivers of one method: what they see, and what is refused."""

import math
import sys

import numpy as np
import pytest
from short_drive import LIDAR, drive, straight

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import OccupancyGrid
from sim.controller import ControllerDriver, ControllerError
from sim.episode import Outcome

WINDOW = 5.0
SCAN = LIDAR.scan(straight().world, straight().start)


def seated(control, make=None, **limits):
    """A driver whose controller returns a control, or what a function of its arguments returns."""

    class Fixed:
        def __init__(self, mission):
            self.mission = mission

        def control(self, *seen):
            return control(*seen) if callable(control) else control

    return ControllerDriver(make or Fixed, straight(), CarLimits(**limits), WINDOW, True)


def test_a_controller_drives_the_car():
    task = straight()
    episode = drive(task, seated(Control(0.5, 0.0)))
    assert episode.outcome == Outcome.REACHED
    assert episode.trace["controls"][:, 0] == pytest.approx(0.5)


def test_it_sees_no_further_than_the_window():
    task, seen = straight(), []

    def look(state, scan, known):
        seen.append((scan, known))
        return Control(0.0, 0.0)

    driver = seated(look)
    state = np.array([*task.start, 0.0])
    full = LIDAR.scan(task.world, state)
    driver.step(state, full)
    scan, known = seen[0]
    assert scan.range_max == pytest.approx(WINDOW / 2 - 0.1)
    near = full.ranges < scan.range_max
    assert near.any()
    assert not near.all()
    assert (scan.ranges[near] == full.ranges[near]).all()
    assert np.isposinf(scan.ranges[~near]).all()
    rows, cols = np.nonzero(~known.unknown)
    x, y = known.frame.centres()
    assert max(abs(x[cols] - state[0]).max(), abs(y[rows] - state[1]).max()) <= WINDOW / 2 + 0.05
    # The map is that of any other driver with this window.
    other = OccupancyGrid(task.world.grid.frame, WINDOW)
    other.integrate(full, state)
    occupied = other.whole().occupied
    assert (known.crop(other.frame).occupied == occupied).all()


def test_it_is_told_the_route_only_if_that_is_prescribed():
    told = []

    def make(mission):
        told.append(mission)
        return seated(Control(0.0, 0.0))._controller

    task = straight()
    for prescribed in (True, False):
        ControllerDriver(make, task, CarLimits(), WINDOW, prescribed)
    assert told[0].waypoints.tolist() == task.waypoints.tolist()
    assert told[1].waypoints is None
    assert told[0].goal == task.goal


@pytest.mark.parametrize(
    ("control", "message"),
    [
        ((1.0, 0.0), "must return a foresee.mapping.control.Control"),
        (Control(math.nan, 0.0), "must be finite"),
        (Control("1", None), "must be finite numbers"),
        (Control(1.0, 0.0, np.array([1, 2])), "gear must be 1"),
        (Control(1.0, 0.0, -1), "gear must be 1: this car has no reverse gear"),
        (Control(1.0, 0.0, 1, 0.5), "cannot turn on the spot"),
        (lambda *seen: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda *seen: sys.exit("enough"), "SystemExit: enough"),
    ],
)
def test_what_is_no_proper_control_is_refused_in_a_line(control, message):
    with pytest.raises(ControllerError, match=message):
        drive(straight(), seated(control))


def test_a_car_with_a_reverse_gear_may_drive_backwards():
    driver = seated(Control(1.0, 0.0, -1), reverse=0.5)
    assert driver.step(np.array([*straight().start, 0.0]), SCAN).plan.gear == -1


def test_in_a_missed_tick_it_brakes_and_turns_no_further():
    driver = seated(Control(0.5, 0.0, 1, 1.0), turn_rate=1.5)
    driver.step(np.array([*straight().start, 0.0]), SCAN)
    control = driver.skip().control
    assert control.acceleration < 0.0
    assert control.turn_rate == 0.0


def test_a_controller_that_cannot_be_made_is_refused():
    with pytest.raises(ControllerError, match="could not be made: TypeError"):
        seated(None, make=lambda: None)
