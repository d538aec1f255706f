"""Scans: a LaserScan becomes a scan, seen from where the robot is now."""

import math
from types import SimpleNamespace as Message

import numpy as np
import pytest
from foresee_navigator.poses import composed
from foresee_navigator.scans import scan_of, seen_from, without_ranges
from foresee_navigator.simulated_robot import fields_of
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.scan import Scan

POSES = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-3.1, 3.1))


def laser(ranges, **changes):
    fields = {"angle_min": -1.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 10.0}
    return Message(ranges=ranges, **(fields | changes))


def test_a_range_below_the_least_is_no_measurement_and_inf_stays():
    scan = scan_of(laser([0.05, 1.0, math.inf, math.nan]), (0.1, 0.0, 0.0))
    assert np.array_equal(scan.ranges, [math.nan, 1.0, math.inf, math.nan], equal_nan=True)
    assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-1.0, 0.1, 10.0)
    assert scan.mount == (0.1, 0.0, 0.0)


def test_a_simulated_scan_survives_its_message():
    scan = Scan(np.array([1.0, 2.0, math.inf]), -0.5, 0.5, 20.0, (0.1, 0.0, 0.0))
    message = Message(ranges=scan.ranges, **fields_of(scan))
    assert message.angle_max == 0.5
    again = scan_of(message, scan.mount)
    assert np.array_equal(again.ranges, scan.ranges)
    assert again.angle_increment == scan.angle_increment


@given(POSES, POSES, POSES)
def test_the_beams_stay_where_they_are_when_the_robot_moves_on(mount, taken, now):
    scan = Scan(np.ones(3), 0.0, 0.1, 10.0, mount)
    moved = seen_from(scan, taken, now)
    x, y, yaw = moved.sensor_pose(*now)
    sensor = composed(taken, mount)
    assert (x, y) == pytest.approx(sensor[:2], abs=1e-8)
    assert math.cos(yaw - sensor[2]) == pytest.approx(1.0)


def test_a_scan_without_ranges_has_its_beams():
    scan = without_ranges(Scan(np.ones(3), 0.0, 0.1, 10.0))
    assert len(scan.ranges) == 3
    assert np.isnan(scan.ranges).all()
