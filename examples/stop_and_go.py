"""A driver that goes to the next waypoint, only as fast as it can stop within what it sees."""

import math

import numpy as np

from foresee.mapping.control import Control


class StopAndGo:
    """Chooses the free arc that is most like the one to the next waypoint."""

    def __init__(self, mission):
        self.car = mission.car
        self.ahead = list([mission.goal] if mission.waypoints is None else mission.waypoints)

    def control(self, state, scan, known):
        """Return the control of an arc, on which the car could stop before what the scan shows."""
        x, y, yaw, v = state
        while len(self.ahead) > 1 and math.dist((x, y), self.ahead[0]) < 2.0:
            self.ahead.pop(0)
        dx, dy = self.ahead[0][0] - x, self.ahead[0][1] - y
        # The curvature of the arc through the waypoint (pure pursuit).
        wanted = 2 * (math.cos(yaw) * dy - math.sin(yaw) * dx) / math.hypot(dx, dy) ** 2
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        ranges = np.fmin(scan.ranges, scan.range_max)
        ahead, side = ranges * np.cos(angles), ranges * np.sin(angles)

        def free(curvature):
            strip = (np.abs(side - 0.5 * curvature * ahead**2) < 0.35) & (ahead > 0)
            return np.min(ahead[strip], initial=scan.range_max) - 0.4

        arcs = np.linspace(-1.2, 1.2, 25)
        curvature = max(arcs, key=lambda arc: min(free(arc), 1.5) - 0.5 * abs(arc - wanted))
        stop_in = max(0.0, free(curvature) - 0.1 * v)
        safe = min(math.sqrt(2 * self.car.braking * stop_in), 1.2 / (abs(curvature) + 0.3))
        return Control((safe - v) / 0.1, curvature)
