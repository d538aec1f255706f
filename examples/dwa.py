"""The dynamic window approach (Fox, Burgard and Thrun 1997), as a driver of the race.

In each tick, the car considers the speeds and curvatures that it can reach within the tick, and
drives the arc that looks best: towards the goal, clear of obstacles, and fast. It considers only
arcs on which it can stop before it meets an obstacle or a cell that it has not seen.
"""

import math

import numpy as np
from scipy.ndimage import distance_transform_edt

from foresee.mapping.control import Control

TICK = 0.1
AHEAD = 2.0
"""Distance of the point on the route that the car heads for [m]."""
HEADING, CLEARANCE, SPEED = 1.0, 0.5, 1.5
"""Weights of the three objectives."""
MARGIN = 0.1
"""Distance kept around the circle about the body, as cells and points of an arc are coarse [m]."""


class DynamicWindow:
    """Chooses among arcs in each tick."""

    def __init__(self, mission):
        self.car = mission.car
        self.route = np.array([mission.goal]) if mission.waypoints is None else mission.waypoints
        self.next = 0
        self.curvatures = np.linspace(-1.0, 1.0, 41) * self.car.max_curvature
        self.last = 0.0

    def control(self, state, scan, known):
        """Return the control of the best arc; without a safe one, brake on the last, which was."""
        x, y, yaw, v = state
        target = self._target(x, y)
        best, chosen = -math.inf, None
        distance = self._clearances(known, x, y)
        for acceleration in (-self.car.braking, -0.5, 0.0, 0.5, self.car.acceleration):
            speed = min(max(v + acceleration * TICK, 0.0), self.car.v_max)
            for curvature in self.curvatures:
                if abs(curvature) * max(v, speed) ** 2 > self.car.lateral_acceleration:
                    continue
                stop = TICK * 0.5 * (v + speed) + speed**2 / (2 * self.car.braking)
                look = max(stop, 1.0)
                points, headings = arc(x, y, yaw, curvature, look)
                clear = distance(points)
                free = clear > self.car.body.radius + MARGIN
                reach = look * (np.argmin(free) / len(free) if not free.all() else 1.0)
                if reach < stop or (speed == 0.0 and v == 0.0):
                    continue
                to = target - points[-1]
                off = abs(math.remainder(math.atan2(to[1], to[0]) - headings[-1], 2 * math.pi))
                score = (
                    HEADING * (1.0 - off / math.pi)
                    + CLEARANCE * min(1.0, clear.min())
                    + SPEED * speed / self.car.v_max
                )
                if score > best:
                    best, chosen = score, Control(acceleration, curvature)
        chosen = chosen or Control(-self.car.braking, self.last)
        self.last = chosen.curvature
        return chosen

    def _target(self, x, y):
        """Return the first point of the route that is not near yet."""
        while self.next < len(self.route) - 1 and math.dist((x, y), self.route[self.next]) < AHEAD:
            self.next += 1
        return self.route[self.next]

    def _clearances(self, known, x, y):
        """Return a function from points (n, 2) to their distance from what is not free [m]."""
        near = known.crop(known.frame.square(x, y, 8.0))
        clearance = distance_transform_edt(near.free) * near.frame.resolution

        def at(points):
            inside, rows, cols = near.frame.locate(points)
            return clearance[rows, cols] if inside.all() else np.zeros(len(points))

        return at


def arc(x, y, yaw, curvature, length):
    """Return points (n, 2) [m] every 0.1 m along an arc, and the headings (n,) [rad] there."""
    along = np.linspace(0.0, length, max(2, math.ceil(length / 0.1)))
    headings = yaw + curvature * along
    middle = yaw + 0.5 * curvature * along
    chord = along * np.sinc(0.5 * curvature * along / math.pi)
    return np.stack([x + chord * np.cos(middle), y + chord * np.sin(middle)], axis=1), headings
