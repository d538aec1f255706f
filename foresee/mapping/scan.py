"""The scan of a planar LIDAR, as in sensor_msgs/LaserScan, with the mount of the sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of a planar LIDAR.

    Attributes:
        ranges: range of each beam, (beams,) [m]. NaN: the beam has no measurement; at or above
            `range_max`, or +inf: no obstacle within range (REP 117).
        angle_min: direction of beam 0 in the sensor's frame [rad].
        angle_increment: angle from one beam to the next [rad].
        range_max: largest range of the sensor [m].
        mount: x, y, yaw of the sensor in the robot's frame [m, m, rad].
    """

    ranges: NDArray[np.float64]
    angle_min: float
    angle_increment: float
    range_max: float
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def sensor_pose(self, x: float, y: float, yaw: float) -> tuple[float, float, float]:
        """Return the sensor's x, y, yaw in the world for a robot at x, y, yaw."""
        mx, my, myaw = self.mount
        cos, sin = math.cos(yaw), math.sin(yaw)
        return x + cos * mx - sin * my, y + sin * mx + cos * my, yaw + myaw
