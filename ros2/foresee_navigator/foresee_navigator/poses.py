"""Poses and motions of the robot: from quaternions and odometry to the navigator's state."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits

Pose = tuple[float, float, float]
"""x, y, yaw [m, m, rad]."""
MEMORY = 2.0
"""Time for which motions are kept [s]."""
AHEAD = 0.25
"""Longest time for which a motion is assumed to go on [s]: a longer guess would blur the map."""


def wrapped(angle: float) -> float:
    """Return the same angle in [−π, π] [rad]."""
    return math.remainder(angle, 2.0 * math.pi)


def yaw_of(quaternion: Any) -> float:
    """Return the yaw of a geometry_msgs/Quaternion [rad]."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_of(yaw: float) -> tuple[float, float, float, float]:
    """Return x, y, z, w of the quaternion of a yaw [rad]."""
    return 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def composed(outer: Pose, inner: Pose) -> Pose:
    """Return a pose that is given in the frame of another pose, in the outer frame."""
    cos, sin = math.cos(outer[2]), math.sin(outer[2])
    x, y, yaw = inner
    return (
        outer[0] + cos * x - sin * y,
        outer[1] + sin * x + cos * y,
        wrapped(outer[2] + yaw),
    )


def inverse(pose: Pose) -> Pose:
    """Return the pose of the outer frame in the frame of a pose."""
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    return -cos * x - sin * y, sin * x - cos * y, -yaw


def seconds(stamp: Any) -> float:
    """Return a builtin_interfaces/Time [s]."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


@dataclass(frozen=True)
class Motion:
    """The robot's motion at one moment.

    Attributes:
        stamp: time [s].
        pose: x, y, yaw [m, m, rad].
        speed: speed along the heading, negative in reverse [m/s].
        yaw_rate: turning rate, positive to the left [rad/s].
    """

    stamp: float
    pose: Pose
    speed: float
    yaw_rate: float

    @property
    def state(self) -> NDArray[np.float64]:
        """x, y, yaw, v as the navigator takes it, (4,) [m, m, rad, m/s]."""
        return np.array([*self.pose, self.speed])

    @property
    def is_finite(self) -> bool:
        """Whether all values are finite."""
        return math.isfinite(self.stamp + sum(self.pose) + self.speed + self.yaw_rate)

    def after(self, time: float) -> Motion:
        """Return the motion after a time [s], of constant speed and yaw rate."""
        half = 0.5 * self.yaw_rate * time
        # The chord of an arc; sinc(0) = 1.
        chord = self.speed * time * float(np.sinc(half / math.pi))
        step = (chord * math.cos(half), chord * math.sin(half), 2.0 * half)
        return Motion(self.stamp + time, composed(self.pose, step), self.speed, self.yaw_rate)


def motion_of(odometry: Any, correction: Pose = (0.0, 0.0, 0.0)) -> Motion:
    """Return the motion of a nav_msgs/Odometry.

    Args:
        odometry: message; its twist is in the frame of the robot (REP 105).
        correction: pose of the odometry's frame in the frame of the map.
    """
    at, twist = odometry.pose.pose, odometry.twist.twist
    pose = (float(at.position.x), float(at.position.y), yaw_of(at.orientation))
    return Motion(
        seconds(odometry.header.stamp),
        composed(correction, pose),
        float(twist.linear.x),
        float(twist.angular.z),
    )


class Track:
    """The recent motions of the robot, and where they break off.

    Args:
        car: the car's limits.
        timeout: time without a pose after which the car is stopped [s].
        leap_distance: error of the position above which the track begins anew [m].
        leap_angle: error of the heading above which it does [rad].
        leap_time: time by which stamps must go back for it to begin anew [s].
    """

    def __init__(
        self,
        car: CarLimits,
        timeout: float,
        leap_distance: float,
        leap_angle: float,
        leap_time: float,
    ) -> None:
        self._car, self._timeout = car, timeout
        self._leap_distance, self._leap_angle = leap_distance, leap_angle
        self._leap_time = leap_time
        self._motions: deque[Motion] = deque()

    def add(self, motion: Motion) -> str:
        """Add a motion.

        Returns:
            Why the track begins anew with this motion; empty if it goes on.
        """
        why = self._break(self._motions[-1], motion) if self._motions else ""
        if why:
            self._motions.clear()
        if self._motions and motion.stamp <= self._motions[-1].stamp:
            return ""  # It was overtaken by a newer one.
        self._motions.append(motion)
        while self._motions[0].stamp < motion.stamp - MEMORY:
            self._motions.popleft()
        return why

    def at(self, stamp: float) -> Motion | None:
        """Return the motion at a time [s]; None if it is not known.

        It is not known before the first motion that is kept, and `AHEAD` after the newest. Until
        then, speed and yaw rate are taken as constant.
        """
        if not self._motions or stamp < self._motions[0].stamp:
            return None
        if stamp > self._motions[-1].stamp + AHEAD:
            return None
        older = self._motions[0]
        for newer in self._motions:
            if newer.stamp > stamp:
                return _between(older, newer, stamp)
            older = newer
        return older.after(stamp - older.stamp)

    def _break(self, last: Motion, new: Motion) -> str:
        time = new.stamp - last.stamp
        if time < -self._leap_time:
            return f"the odometry's stamps went back by {-time:.1f} s"
        if time <= 0.0:
            return ""
        # After a pause, the car has gone no further than until the timeout, and in the stop.
        moving = min(time, self._timeout)
        top = abs(last.speed) + self._car.acceleration * moving
        far = top * moving
        if time > self._timeout:
            far += 0.5 * top**2 / self._car.braking
        moved = math.dist(last.pose[:2], new.pose[:2])
        if moved > self._leap_distance + far:
            return f"the pose leapt by {moved:.2f} m"
        turned = abs(wrapped(new.pose[2] - last.pose[2]))
        if turned > self._leap_angle + far * self._car.max_curvature:
            return f"the heading leapt by {math.degrees(turned):.0f}°"
        return ""


def _between(older: Motion, newer: Motion, stamp: float) -> Motion:
    """Return the motion at a time between two motions [s], by linear interpolation."""
    share = (stamp - older.stamp) / (newer.stamp - older.stamp)
    turn = wrapped(newer.pose[2] - older.pose[2])
    x, y, speed, rate = (
        (1.0 - share) * a + share * b
        for a, b in (
            (older.pose[0], newer.pose[0]),
            (older.pose[1], newer.pose[1]),
            (older.speed, newer.speed),
            (older.yaw_rate, newer.yaw_rate),
        )
    )
    return Motion(stamp, (x, y, wrapped(older.pose[2] + share * turn)), speed, rate)
