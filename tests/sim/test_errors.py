"""Errors of the simulated robot: they keep to their bounds, and the car is safe within them."""

import math

import numpy as np
import pytest

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings
from foresee.mapping.control import Control
from foresee.mapping.error_bounds import ErrorBounds
from sim import DubinsCar
from sim.errors import Actuators, Errors, PoseEstimate, Robot

BOUNDS = {
    "delay": {"delay": 0.3},
    "jitter": {"delay": 0.1, "jitter": 0.03},
    "lag": {"lag": 0.15},
    "pose": {"pose_error": 0.05, "yaw_error": 0.01},
    "ranges": {"noise": 0.01, "dropout": 0.05},
    "missed": {"missed": 0.3},
    "all": {"delay": 0.15, "lag": 0.05, "pose_error": 0.02, "yaw_error": 0.005, "missed": 0.1},
}


def acting(bounds, controls, dt=0.1):
    """Return the acceleration that acts at each moment of some ticks, [(time, acceleration)]."""
    actuators, out, time = Actuators(bounds, np.random.default_rng(0)), [], 0.0
    for control in controls:
        for now, span in actuators.during(control, dt, True):
            out.append((time, now.acceleration))
            time += span
    return out, time


def test_without_errors_each_control_acts_at_once():
    control = Control(1.0, 0.3)
    actuators = Actuators(ErrorBounds(), np.random.default_rng(0))
    assert list(actuators.during(control, 0.1, True)) == [(control, 0.1)]


@pytest.mark.parametrize("delay", [0.1, 0.13, 0.25])
def test_a_control_acts_after_the_delay(delay):
    out, time = acting(ErrorBounds(delay=delay), [Control(0.1 * n, 0.0) for n in range(1, 9)])
    assert time == pytest.approx(0.8)
    first = next(begin for begin, a in out if a > 0.0)
    assert first == pytest.approx(delay)
    for begin, a in out:
        assert a == pytest.approx(0.1 * max(0, math.floor((begin - delay) / 0.1 + 1e-6) + 1))


def test_jitter_delays_a_control_by_its_bound_at_most_and_keeps_the_order():
    bounds = ErrorBounds(delay=0.1, jitter=0.05)
    out, _ = acting(bounds, [Control(float(n), 0.0) for n in range(1, 40)])
    begins = {}
    for begin, a in out:
        begins.setdefault(a, begin)
    late = [begins[n] - 0.1 * (n - 1) for n in range(1, 37) if n in begins]
    assert min(late) >= 0.1 - 1e-9
    assert max(late) <= 0.15 + 1e-9
    assert max(late) - min(late) > 0.04


def test_a_lag_is_of_first_order():
    out, _ = acting(ErrorBounds(lag=0.2), [Control(1.0, 0.0)] * 10)
    for begin, a in out[1:]:
        assert a == pytest.approx(1.0 - math.exp(-(begin + 0.005) / 0.2), abs=2e-3)


def test_an_estimate_lies_within_its_bounds_and_comes_near_them():
    bounds = ErrorBounds(position=0.05, yaw=0.02)
    estimate = PoseEstimate(bounds, np.random.default_rng(0))
    state = np.array([1.0, 2.0, 3.1, 0.5])
    off = np.array([estimate.of(state) for _ in range(2000)]) - state
    off[:, 2] = np.remainder(off[:, 2] + np.pi, 2 * np.pi) - np.pi
    away = np.hypot(off[:, 0], off[:, 1])
    assert 0.045 < away.max() <= 0.05 + 1e-12
    assert 0.018 < np.abs(off[:, 2]).max() <= 0.02 + 1e-12
    assert (off[:, 3] == 0.0).all()
    assert PoseEstimate(ErrorBounds(), np.random.default_rng(0)).of(state) is state


def test_decisions_are_missing_for_a_few_ticks_at_most_and_never_in_the_first():
    robot = Robot(Errors(missed=0.9, most_missed=3), np.random.default_rng(0))
    missed = "".join("x" if robot.misses() else "." for _ in range(500))
    assert missed[0] == "."
    assert "xxx" in missed
    assert "xxxx" not in missed
    with pytest.raises(ValueError, match="missed"):
        Errors(missed=1.5)


@pytest.mark.slow(10)
@pytest.mark.parametrize("name", [*BOUNDS])
def test_a_car_that_is_told_the_bounds_reaches_its_goal(name):
    settings = Settings(
        world=("corridor",), route="fixed", predictor="none", seed=20006, **BOUNDS[name]
    )
    result = drive(settings, 0, "backup").result
    assert result.outcome == "reached"
    assert result.faults.get("emergency", 0) == 0


def test_a_car_that_is_not_told_its_delay_is_not_safe():
    untold = {"delay": 0.5, "lag": 0.3, "told_delay": 0.0, "told_lag": 0.0}
    settings = Settings(world=("corridor",), route="fixed", seed=20000, **untold)
    assert drive(settings, 0, "backup").result.outcome == "collided"


def test_the_car_without_errors_moves_as_before():
    car, state = DubinsCar(), np.array([0.0, 0.0, 0.0, 1.0])
    actuators = Actuators(ErrorBounds(), np.random.default_rng(0))
    for control, span in actuators.during(Control(0.5, 0.2), 0.1, True):
        moved = car.step(state, control, span)
    assert (moved == car.step(state, Control(0.5, 0.2), 0.1)).all()


def test_a_lag_leaves_a_turn_on_the_spot():
    actuators = Actuators(ErrorBounds(lag=0.15), np.random.default_rng(0))
    turning = Control(0.0, 0.0, 1, 0.5)
    assert {now.turn_rate for now, _ in actuators.during(turning, 0.1, False)} == {0.5}
