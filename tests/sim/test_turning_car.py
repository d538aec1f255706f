"""The simulated car turns on the spot: at standstill, at a bounded rate, and judged all along."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from sim.car import DubinsCar
from sim.world import World

CAR = DubinsCar(CarLimits(reverse=0.5, turn_rate=1.5))
rates = st.floats(-10, 10).filter(lambda rate: abs(rate) > 1e-6)
yaws = st.floats(-math.pi, math.pi)


@given(yaws, rates, st.floats(0.01, 1.0))
def test_a_standing_car_turns_in_place_at_a_bounded_rate(yaw, rate, dt):
    end = CAR.step([1.0, -2.0, yaw, 0.0], Control(1.0, 1.0, 1, rate), dt)
    assert (end[0], end[1], end[3]) == (1.0, -2.0, 0.0)
    turned = math.remainder(end[2] - yaw, 2 * math.pi)
    wanted = min(max(rate, -1.5), 1.5) * dt
    assert math.remainder(turned - wanted, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(yaws, rates)
def test_two_half_steps_make_a_whole_one(yaw, rate):
    control, state = Control(0.0, 0.0, 1, rate), np.array([0.0, 0.0, yaw, 0.0])
    twice = CAR.step(CAR.step(state, control, 0.05), control, 0.05)
    off = math.remainder(twice[2] - CAR.step(state, control, 0.1)[2], 2 * math.pi)
    assert off == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-0.5, 4.0).filter(lambda v: abs(v) > 1e-5), rates, st.floats(-1.5, 1.5))
def test_a_car_that_moves_does_not_turn_on_the_spot(v, rate, acceleration):
    state = [0.0, 0.0, 0.3, v]
    with_rate = CAR.step(state, Control(acceleration, 0.2, 1, rate), 0.1)
    assert np.array_equal(with_rate, CAR.step(state, Control(acceleration, 0.2), 0.1))


def test_a_car_that_cannot_turn_on_the_spot_refuses_to():
    with pytest.raises(ValueError, match=r"turn_rate is 0\.5 rad/s, but the car cannot"):
        DubinsCar().step([0.0, 0.0, 0.0, 0.0], Control(0.0, 0.0, 1, 0.5), 0.1)
    with pytest.raises(ValueError, match="must be finite"):
        CAR.step([0.0, 0.0, 0.0, 0.0], Control(0.0, 0.0, 1, math.nan), 0.1)


@given(yaws, rates, st.floats(0.001, 0.1))
def test_no_corner_moves_further_than_the_spacing_between_the_poses_of_a_turn(yaw, rate, spacing):
    control = Control(0.0, 0.0, 1, rate)
    poses = CAR.motion([0.0, 0.0, yaw, 0.0], control, 0.1, spacing)
    steps = np.diff(np.concatenate([[yaw], poses[:, 2]]))
    assert (np.abs(steps) * CAR.limits.body.radius <= spacing * (1 + 1e-9)).all()
    end = CAR.step([0.0, 0.0, yaw, 0.0], control, 0.1)[2]
    assert math.remainder(poses[-1, 2] - end, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_a_cell_that_a_corner_passes_in_the_middle_of_a_turn_is_a_collision():
    cells = np.full((100, 100), FREE, dtype=np.int8)
    frame = GridFrame(0.01, (-0.5, -0.5), (100, 100))
    # The corner reaches 0.29 m, the front 0.25 m.
    row, col = (int(values[0]) for values in frame.locate(np.array([[0.285, 0.001]]))[1:])
    cells[row, col] = OCCUPIED
    world, control = World("post", Grid(frame, cells)), Control(0.0, 0.0, 1, 1.5)
    half = math.atan2(0.15, 0.25)
    start, dt = np.array([0.0, 0.0, -half - 0.3, 0.0]), 0.6 / 1.5
    standing = Control(0.0, 0.0)
    assert CAR.collides(world, start, control, dt)
    end = CAR.step(start, control, dt)
    assert not CAR.collides(world, start, standing, dt)
    assert not CAR.collides(world, end, standing, dt)
