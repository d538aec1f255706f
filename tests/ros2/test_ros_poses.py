"""Poses and motions: what arrives on /odom becomes the navigator's state."""

import math
from types import SimpleNamespace as Message

import numpy as np
import pytest
from foresee_navigator.poses import (
    AHEAD,
    Motion,
    Track,
    composed,
    inverse,
    motion_of,
    quaternion_of,
    yaw_of,
)
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.car_limits import CarLimits

LENGTHS = st.floats(-50.0, 50.0)
ANGLES = st.floats(-3.1, 3.1)
POSES = st.tuples(LENGTHS, LENGTHS, ANGLES)


def quaternion(yaw):
    return Message(**dict(zip("xyzw", quaternion_of(yaw), strict=True)))


def odometry(x, y, yaw, speed, rate, sec=3, nanosec=500_000_000):
    pose = Message(position=Message(x=x, y=y), orientation=quaternion(yaw))
    twist = Message(linear=Message(x=speed), angular=Message(z=rate))
    stamp = Message(sec=sec, nanosec=nanosec)
    return Message(header=Message(stamp=stamp), pose=Message(pose=pose), twist=Message(twist=twist))


def track():
    return Track(CarLimits(v_max=2.0), 0.5, 0.5, 0.5, 0.2)


@given(ANGLES)
def test_a_yaw_survives_its_quaternion(yaw):
    assert yaw_of(quaternion(yaw)) == pytest.approx(yaw, abs=1e-9)


@given(POSES, POSES)
def test_a_pose_and_its_inverse_cancel(outer, inner):
    there = composed(inverse(outer), composed(outer, inner))
    assert there == pytest.approx(inner, abs=1e-9)


def test_odometry_becomes_a_state_in_the_frame_of_the_map():
    motion = motion_of(odometry(2.0, 0.0, 0.0, 1.5, 0.3), (1.0, 1.0, math.pi / 2))
    assert motion.stamp == 3.5
    assert motion.state == pytest.approx([1.0, 3.0, math.pi / 2, 1.5])
    assert motion.yaw_rate == 0.3


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.0, 1.0))
def test_a_motion_in_two_parts_ends_where_the_whole_does(speed, rate, share):
    start = Motion(0.0, (1.0, 2.0, 0.5), speed, rate)
    parts = start.after(share).after(1.0 - share)
    assert parts.pose == pytest.approx(start.after(1.0).pose, abs=1e-9)


def test_between_two_poses_a_track_is_straight_and_turns_the_short_way():
    found = track()
    assert not found.add(Motion(0.0, (0.0, 0.0, math.pi - 0.1), 1.0, 0.0))
    assert not found.add(Motion(0.2, (-0.2, 0.0, -math.pi + 0.1), 1.0, 0.0))
    x, _, yaw = found.at(0.1).pose
    assert x == pytest.approx(-0.1)
    assert abs(yaw) == pytest.approx(math.pi)
    assert found.at(0.3).pose[0] == pytest.approx(-0.3, abs=2e-2)
    assert found.at(-0.1) is None


def test_a_motion_is_not_guessed_for_long():
    found = track()
    found.add(Motion(1.0, (0.0, 0.0, 0.0), 1.0, 0.0))
    assert found.at(1.0 + AHEAD).pose[0] == pytest.approx(AHEAD)
    assert found.at(1.01 + AHEAD) is None


def test_a_track_that_follows_the_motion_never_breaks_off():
    found, motion = track(), Motion(0.0, (0.0, 0.0, 0.0), 2.0, 1.0)
    for _ in range(300):
        assert found.add(motion) == ""
        motion = motion.after(0.1)


@pytest.mark.parametrize(
    ("stamp", "x", "yaw", "why"),
    [
        (1.1, 3.0, 0.0, "the pose leapt by 3.00 m"),
        (1.02, 0.0, 2.0, "the heading leapt by 115°"),
        (0.1, 0.0, 0.0, "the odometry's stamps went back by 0.9 s"),
        (9.0, 8.0, 0.0, "the pose leapt by 8.00 m"),
    ],
)
def test_a_leap_is_told_and_the_track_begins_anew(stamp, x, yaw, why):
    found = track()
    found.add(Motion(1.0, (0.0, 0.0, 0.0), 1.0, 0.0))
    assert found.add(Motion(stamp, (x, 0.0, yaw), 1.0, 0.0)) == why
    assert found.at(stamp).pose == (x, 0.0, yaw)
    assert found.at(stamp - 0.01) is None


def test_a_pause_in_which_the_car_stops_is_no_leap():
    found = track()
    found.add(Motion(1.0, (0.0, 0.0, 0.0), 2.0, 0.0))
    # 0.5 s until the timeout, and 1.3 m in which it brakes.
    assert found.add(Motion(9.0, (2.3, 0.0, 0.0), 0.0, 0.0)) == ""


def test_an_overtaken_message_changes_nothing():
    found = track()
    found.add(Motion(1.0, (1.0, 0.0, 0.0), 1.0, 0.0))
    assert found.add(Motion(0.95, (7.0, 0.0, 0.0), 1.0, 0.0)) == ""
    assert np.allclose(found.at(1.0).pose, (1.0, 0.0, 0.0))
