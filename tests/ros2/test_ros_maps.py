"""Maps as nav_msgs/OccupancyGrid, and the speed limit for another planner."""

import numpy as np
import pytest
from foresee_navigator.forecast import Forecaster, fastest
from foresee_navigator.maps import observed_values, predicted_values
from foresee_navigator.poses import Motion
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.error_bounds import NO_ERRORS, ErrorBounds
from foresee.mapping.grid import HIGHEST, LOWEST, GridFrame
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.navigator_config import NavigatorConfig
from planner.risk.ask_predictor import LateError
from sim import Lidar, empty_straight

CAR = CarLimits(v_max=4.0)


def test_observed_values_rise_with_the_evidence_and_0_is_unknown():
    levels = np.arange(LOWEST, HIGHEST + 1, dtype=np.int8)[None]
    values = observed_values(levels)[0]
    assert values[levels[0] == 0] == -1
    known = values[levels[0] != 0]
    assert (np.diff(known) >= 0).all()
    assert 0 <= known.min() < 50 < known.max() <= 100


def test_predicted_values_are_unknown_without_confidence():
    frame = GridFrame(0.05, (0.0, 0.0), (1, 4))
    free = np.array([[1.0, 0.25, 0.25, 0.0]], np.float32)
    confidence = np.array([[1.0, 0.6, 0.4, 0.0]], np.float32)
    prediction = Prediction(frame, free, 1 - free, confidence)
    assert predicted_values(prediction, 0.5).tolist() == [[0, 75, -1, -1]]
    assert predicted_values(prediction, 0.0).tolist() == [[0, 75, 75, -1]]


class Late:
    """Stands for a process whose answer comes a tick after the question."""

    side = context_side = 0.0

    def __init__(self):
        self.views = []

    def ask(self, view, patience):
        self.views.append(view)
        raise LateError

    def take_late(self):
        known = self.views[-1].known
        everywhere = np.ones(known.frame.shape)
        return Prediction(known.frame, everywhere, 0.0 * everywhere, everywhere)


def test_a_late_prediction_is_used_when_it_is_there():
    forecaster = Forecaster(NavigatorConfig(car=CAR, reliance=0.3), Late(), 0.05)
    motion = Motion(0.0, (5.0, 2.0, 0.0), 1.0, 0.0)
    scan = Lidar().scan(empty_straight(12.0, 3.0), motion.pose)
    first, second = (forecaster.look(motion, scan) for _ in range(2))
    assert first.prediction is None
    assert second.prediction is not None
    assert first.faults == second.faults == (Fault.PREDICTOR_LATE,)
    assert second.speed_limit > first.speed_limit


@given(st.floats(0.0, 20.0), st.floats(0.0, 1.0))
def test_from_the_speed_limit_the_car_stops_within_the_distance(distance, delay):
    speed = fastest(distance, CAR, delay)
    assert 0.0 <= speed <= CAR.v_max
    needed = speed * delay + speed**2 / (2 * CAR.braking)
    assert needed <= distance + 1e-9
    assert speed == CAR.v_max or needed == pytest.approx(distance, abs=1e-9)


def limit_at(x: float, bounds: ErrorBounds = NO_ERRORS) -> float:
    """Return the speed limit at a distance along a corridor that ends at 12 m [m/s]."""
    forecaster = Forecaster(NavigatorConfig(car=CAR, bounds=bounds), None, 0.05)
    motion = Motion(0.0, (x, 2.0, 0.0), 1.0, 0.0)
    scan = Lidar().scan(empty_straight(12.0, 3.0), motion.pose)
    return forecaster.look(motion, scan).speed_limit


def test_the_speed_limit_falls_towards_a_wall():
    limits = [limit_at(x) for x in (4.0, 8.0, 10.0, 11.3, 11.8)]
    # Until the window ends at the wall, the end of the window limits the speed.
    assert limits[0] == pytest.approx(limits[1], abs=0.1)
    assert limits == sorted(limits, reverse=True)
    assert limits[-1] < 0.5 < limits[0]


@pytest.mark.parametrize("late", ["delay", "jitter", "lag"])
def test_the_speed_limit_falls_with_the_time_until_the_robot_brakes(late):
    assert limit_at(4.0, ErrorBounds(**{late: 0.3})) < limit_at(4.0) - 0.1
