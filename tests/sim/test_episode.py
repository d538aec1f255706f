"""A drive with a reverse gear, and what is recorded of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from short_drive import LIDAR, straight

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import OccupancyGrid
from planner.safety.limiting_factor import Limit
from sim import DubinsCar
from sim.episode import EpisodeConfig, Outcome, run_episode

TICKS = (12, 8, 8, 4)
"""Speeding up forwards, braking, speeding up in reverse, braking."""
FORWARDS, BACKWARDS = Control(1.0, 0.2), Control(1.0, 0.2, -1)
BRAKING, BRAKING_BACKWARDS = Control(-2.0, 0.2), Control(-2.0, 0.2, -1)


class Shunter:
    """Drives forwards to a stop, then backwards, and so on."""

    def __init__(self, task, controls, times=()):
        self.known = OccupancyGrid(task.world.grid.frame, 5.0)
        self.path_counts = {}
        self.controls = controls
        self.times = times
        self.tick = 0

    def step(self, state, scan):
        self.known.integrate(scan, state)
        control = self.controls[self.tick % len(self.controls)]
        self.tick += 1
        plan = SimpleNamespace(
            states=np.tile(state, (3, 1)), controls=np.zeros((2, 2)), gear=control.gear
        )
        return SimpleNamespace(
            control=control,
            plan=plan,
            last_resort=plan.controls,
            limit=Limit.GOAL,
            faults=(),
            emergency=False,
            relied=np.empty((0, 2)),
            times=self.times[self.tick - 1] if self.times else {"cycle": 1.0},
        )


def drive(controls, seconds=10.0, times=()):
    task = straight()
    car = DubinsCar(CarLimits(reverse=0.5))
    config = EpisodeConfig(timeout=seconds * car.limits.v_max / task.path_length)
    driver = Shunter(task, controls, times)
    return run_episode(task, driver, car, LIDAR, config, np.random.default_rng(0))


def shunting():
    kinds = (FORWARDS, BRAKING, BACKWARDS, BRAKING_BACKWARDS)
    return [kind for kind, count in zip(kinds, TICKS, strict=True) for _ in range(count)]


def test_the_gear_of_every_tick_is_recorded_beside_its_control():
    episode = drive(shunting(), sum(TICKS) * 0.1)
    trace = episode.trace
    assert trace["controls"].shape == (sum(TICKS), 2)
    assert trace["gears"].dtype == np.int8
    forwards = TICKS[0] + TICKS[1]
    assert trace["gears"].tolist() == [1] * forwards + [-1] * (sum(TICKS) - forwards)
    assert trace["states"][:, 3].min() == pytest.approx(-0.5)


def test_the_time_of_each_stage_is_recorded_under_its_name():
    times = [{"path": 30.0, "mpc": 5.0}, {"mpc": 6.0, "path": 20.0}, {"mpc": 7.0, "late": 1.0}]
    trace = drive([FORWARDS] * 3, 0.3, times).trace
    names = trace["time_names"].tolist()
    assert names[1:] == ["path", "mpc", "late"]
    assert trace["times"][:, 1:].tolist() == [[30, 5, 0], [20, 6, 0], [0, 7, 1]]


def test_speeds_and_stops_count_in_either_gear():
    episode = drive(shunting(), sum(TICKS) * 0.1)
    speed = np.abs(episode.trace["states"][:, 3])
    assert episode.max_speed == speed.max()
    assert episode.stops == 2
    assert episode.mean_speed == pytest.approx((speed[1:] + speed[:-1]).mean() / 2, rel=0.01)
    back = drive([BACKWARDS] * 10, 2.0)
    assert back.max_speed == pytest.approx(0.5)
    assert back.mean_speed > 0


@pytest.mark.parametrize(
    ("controls", "hard"),
    [
        ([FORWARDS] * 12 + [BRAKING] * 12, 1),
        ([FORWARDS] * 12 + [Control(-1.0, 0.2)] * 16, 0),
        # Hard at first, and gently to rest.
        ([FORWARDS] * 12 + [BRAKING] * 4 + [Control(-0.5, 0.2)] * 16, 0),
        # To change gear.
        (shunting()[: -TICKS[3]], 0),
        ([FORWARDS] * 12, 0),
    ],
)
def test_a_stop_is_hard_if_the_car_brakes_near_its_limit_to_rest_and_goes_on(controls, hard):
    assert drive(controls, len(controls) * 0.1).hard_stops == hard


def test_backing_into_a_wall_is_a_collision_at_the_speed_it_had():
    episode = drive([Control(1.0, 0.0, -1)], 20.0)
    assert episode.outcome == Outcome.COLLIDED
    assert episode.impact_speed == pytest.approx(0.5)
