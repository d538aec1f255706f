"""What a car sees in a window: scans that end there, and the map of all that was seen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.scan import Scan
from sim.task import Task


class Sight:
    """The map that a car makes during a drive, of what lies in the window around it.

    Args:
        task: task to drive.
        body: the car's body.
        window: side of the square around the car in which the LIDAR is used [m].
    """

    def __init__(self, task: Task, body: Body, window: float) -> None:
        self.body = body
        self.known = task.blank(window)
        task.mark_start(self.known, body)

    def add(self, scan: Scan, state: NDArray[np.float64]) -> Scan:
        """Add a scan, taken at a state, to the map, and return the part of it `within` the window.

        Args:
            scan: scan of the LIDAR.
            state: x, y, yaw, ... of the car [m, m, rad].
        """
        self.known.integrate(scan, state)
        self.known.mark_under(state, self.body)
        return within(scan, self.known.window)


def within(scan: Scan, window: float) -> Scan:
    """Return a scan that reaches no further than a window around the car.

    Args:
        scan: scan of the LIDAR.
        window: side of the square around the car [m]. The scan reaches as far as the circle around
            the sensor that lies inside of it.
    """
    reach = min(scan.range_max, 0.5 * window - math.hypot(*scan.mount[:2]))
    ranges = np.where(scan.ranges >= reach, np.inf, scan.ranges)
    return replace(scan, ranges=ranges, range_max=reach)
