"""Scans: from sensor_msgs/LaserScan to the navigator's, and back for the simulator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foresee.mapping.scan import Scan
from foresee_navigator.poses import Pose, composed, inverse


def scan_of(message: Any, mount: Pose) -> Scan:
    """Return the scan of a sensor_msgs/LaserScan.

    A range below `range_min` is no measurement. One at or above `range_max` means that nothing is
    within range (REP 117).

    Args:
        message: the message.
        mount: pose of the LIDAR in the frame of the robot.
    """
    ranges = np.array(message.ranges, dtype=np.float64)
    ranges[ranges < message.range_min] = np.nan
    return Scan(
        ranges,
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_max),
        mount,
    )


def seen_from(scan: Scan, taken_at: Pose, now_at: Pose) -> Scan:
    """Return the scan as if the robot had already been at another pose when it was taken.

    The navigator takes a scan and a state of one moment. The robot has moved since the scan was
    taken; its beams stay where they are in the building if the mount moves the other way.

    Args:
        scan: scan.
        taken_at: pose of the robot when it was taken.
        now_at: pose of the robot that the navigator is told.
    """
    return replace(scan, mount=composed(inverse(now_at), composed(taken_at, scan.mount)))


def without_ranges(scan: Scan) -> Scan:
    """Return a scan that changes no cell: a measurement counts once, however often it is read."""
    return replace(scan, ranges=np.full_like(scan.ranges, np.nan))
