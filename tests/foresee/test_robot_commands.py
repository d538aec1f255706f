"""Controls as commands of robots: they agree with the simulated car, in both gears."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.commands import TwistCommand, steering_of, twist_of
from foresee.mapping.control import Control
from sim import DubinsCar

CAR = CarLimits(reverse=0.5)
PAGE = Path(__file__).parents[2] / "docs/how-to/units_and_frames.md"
speeds = st.floats(-CAR.reverse, CAR.v_max)
accelerations = st.floats(-CAR.braking, CAR.acceleration)
curvatures = st.floats(-CAR.max_curvature, CAR.max_curvature)
gears = st.sampled_from([1, -1])


@given(speeds, accelerations, gears)
def test_the_speed_is_that_of_the_simulated_car_after_the_tick(speed, acceleration, gear):
    control = Control(acceleration, 0.0, gear)
    end = DubinsCar(CAR).step([0.0, 0.0, 0.0, speed], control, 0.1)[3]
    assert twist_of(control, speed, CAR).speed == pytest.approx(end, abs=1e-6)


@given(st.floats(0.1, 1.0), curvatures, gears)
def test_at_a_constant_speed_the_yaw_rate_is_that_of_the_simulated_car(speed, curvature, gear):
    speed = speed if gear > 0 else -0.5 * speed
    control = Control(0.0, curvature, gear)
    turned = DubinsCar(CAR).step([0.0, 0.0, 0.0, speed], control, 0.1)[2]
    assert 0.1 * twist_of(control, speed, CAR).yaw_rate == pytest.approx(turned, abs=1e-9)


@given(speeds, accelerations, curvatures, gears, st.floats(0.1, 0.5), st.floats(0.0, 0.4))
def test_a_steering_angle_leads_back_to_the_arc_and_the_speed_of_the_reference_point(
    speed, acceleration, curvature, gear, wheelbase, ahead
):
    control = Control(acceleration, curvature, gear)
    command = steering_of(control, speed, CAR, wheelbase, ahead)
    twist = twist_of(control, speed, CAR)
    rear = math.tan(command.steering_angle) / wheelbase
    # The yaw rate of a rigid body is that of each of its points.
    assert command.speed * rear == pytest.approx(twist.yaw_rate, abs=1e-9)
    assert rear / math.hypot(1.0, rear * ahead) == pytest.approx(curvature, abs=1e-9)
    sideways = command.speed * rear * ahead
    assert math.hypot(command.speed, sideways) == pytest.approx(abs(twist.speed), abs=1e-9)
    assert command.acceleration >= 0.0


@given(speeds, st.floats(-20, 20), curvatures, gears)
def test_commands_keep_to_the_limits_of_the_gear(speed, acceleration, curvature, gear):
    twist = twist_of(Control(acceleration, curvature, gear), speed, CAR)
    assert -CAR.reverse <= twist.speed <= CAR.v_max
    # A car that moves does not change its direction within a tick.
    assert twist.speed * speed >= 0.0 or abs(speed) < 1e-6


def test_left_is_positive_in_both_gears():
    left = Control(0.0, 0.5)
    assert twist_of(left, 1.0, CAR).yaw_rate > 0.0 > twist_of(left, -0.4, CAR).yaw_rate
    # In reverse, the wheels that point to the left turn the heading to the right.
    assert steering_of(left, 1.0, CAR, 0.3).steering_angle > 0.0
    assert steering_of(left, -0.4, CAR, 0.3).steering_angle > 0.0
    assert steering_of(left, -0.4, CAR, 0.3).speed < 0.0


@given(st.floats(-5, 5).filter(bool), curvatures)
def test_a_turn_on_the_spot_is_a_yaw_rate_at_standstill_alone(rate, curvature):
    car = CarLimits(reverse=0.5, turn_rate=1.5)
    control = Control(0.0, curvature, 1, rate)
    assert twist_of(control, 0.0, car) == TwistCommand(0.0, min(max(rate, -1.5), 1.5))
    assert twist_of(control, 1.0, car) == twist_of(Control(0.0, curvature), 1.0, car)
    with pytest.raises(ValueError, match="a car with front steering cannot turn on the spot"):
        steering_of(control, 0.0, car, 0.3)


def test_what_no_car_can_drive_is_refused():
    with pytest.raises(ValueError, match="speed is nan"):
        twist_of(Control(0.0, 0.0), math.nan, CAR)
    with pytest.raises(ValueError, match="wheelbase is 0"):
        steering_of(Control(0.0, 0.0), 1.0, CAR, 0.0)
    with pytest.raises(ValueError, match="cannot move on an arc"):
        steering_of(Control(0.0, 1.0), 1.0, CAR, 0.3, ahead=1.0)


def test_the_error_of_the_centre_as_reference_point_is_as_documented():
    # A real car whose rear axle lies 0.2 m behind (x, y) is steered by the commands for (x, y).
    ahead, wheelbase, control = 0.2, 0.4, Control(0.0, 1.0)
    model = np.zeros(4)
    model[3] = 1.0
    rear = np.array([-ahead, 0.0, 0.0, 0.0])
    command = steering_of(control, 1.0, CAR, wheelbase, ahead)
    rear[3], arc = command.speed, Control(0.0, math.tan(command.steering_angle) / wheelbase)
    # The simulated car stands for the rear axle of the real one: its turns may be tighter here.
    tight = CarLimits(turning_radius=0.3, lateral_acceleration=10.0)
    for _ in range(10):
        model = DubinsCar(tight).step(model, control, 0.1)
        rear = DubinsCar(tight).step(rear, arc, 0.1)
    real = rear[:2] + ahead * np.array([math.cos(rear[2]), math.sin(rear[2])])
    assert rear[2] == pytest.approx(model[2])
    off = float(np.hypot(*(real - model[:2])))
    assert off <= 2.0 * ahead * math.sin(0.5 * rear[2]) + 0.02
    assert off > 0.1


def test_the_examples_of_the_page_run():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert blocks
    names = {}
    for block in blocks:
        exec(block, names)
    assert names["twist"].speed == pytest.approx(1.1)
    assert names["drive"].steering_angle == pytest.approx(math.atan(0.33 * 0.5))
