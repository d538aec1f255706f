"""On the wall clock a late decision is not carried out, and the car goes on with what was kept."""

import numpy as np
from short_drive import LIDAR, drive, navigator, straight

from planner.fault import Fault
from sim import DubinsCar
from sim.episode import EpisodeConfig, Outcome, run_episode
from sim.wall_clock import OnWallClock


class Clock:
    """A clock that only moves when it is told to."""

    time = 0.0

    def now(self):
        return self.time

    def sleep(self, span):
        self.time += span


def on_clock(task, spans):
    """A driver whose steps take some times [s] by the number of the step; the others take none."""
    clock, driver, steps = Clock(), navigator(task), []
    step = driver.step

    def slow(state, scan):
        decision = step(state, scan)
        clock.time += spans(len(steps))
        steps.append(clock.time)
        return decision

    driver.step = slow
    return OnWallClock(driver, 0.1, clock.now, clock.sleep), clock


def episode(task, driver, **changes):
    rng = np.random.default_rng(0)
    return run_episode(task, driver, DubinsCar(), LIDAR, EpisodeConfig(**changes), rng)


def test_a_drive_without_late_decisions_is_the_same_and_takes_its_time():
    task = straight()
    expected = drive(task, navigator(task))
    timed, clock = on_clock(task, lambda n: 60.0 if n == 0 else 0.09)
    found = episode(task, timed)
    assert np.array_equal(found.trace["states"], expected.trace["states"])
    assert timed.late == 0
    # The first decision is made while the car stands.
    assert abs(clock.time - 60.0 - found.time) < 0.2


def test_a_late_decision_costs_all_the_ticks_that_it_took():
    task = straight()
    timed, clock = on_clock(task, lambda n: 0.25 if n == 20 else 0.0)
    found = episode(task, timed)
    assert found.outcome is Outcome.REACHED
    assert timed.late == found.faults[Fault.MISSED_TICK] == 3
    assert abs(clock.time - found.time) < 0.2


def test_a_driver_that_is_often_late_does_not_collide():
    task = straight()
    spans = np.random.default_rng(1).choice([0.0, 0.15, 0.45], 1000, p=[0.6, 0.2, 0.2])
    timed, _ = on_clock(task, lambda n: spans[n] if n else 0.0)
    found = episode(task, timed, timeout=3.0)
    assert timed.late > 20
    assert found.outcome is not Outcome.COLLIDED
    assert found.path_length > 5.0
