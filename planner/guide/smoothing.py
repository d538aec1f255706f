"""Smooth paths: compute lines along routes, test whether the car can drive them, and price them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from planner.guide.elastic_band import BODY_MARGIN, LineConfig, curvatures, lines_along, speeds
from planner.motion.path import POINT_SPACING, Path
from planner.risk.cost_map import CostMap
from planner.risk.risk_map import RiskMap

SLOWEST = 0.5
"""Lower bound of the speed from which a path's price is computed [m/s]."""


class Smoother:
    """Turns polylines into smooth paths on a map.

    Args:
        cost: cost map of the whole map.
        near: newest risk map around the car.
        goal: x, y of the goal [m].
        car: the car's limits and body.
        config: settings of the line.
    """

    def __init__(
        self,
        cost: CostMap,
        near: RiskMap,
        goal: tuple[float, float],
        car: CarLimits,
        config: LineConfig,
    ) -> None:
        self.cost, self.near, self.goal = cost, near, goal
        self.car, self.config = car, config
        # Two circles cover the body, as in the MPC.
        offsets, self._radius = car.body.circles(2)
        self._offset = float(offsets[-1])

    def along(
        self, polyline: NDArray[np.float64], pose: NDArray[np.float64], source: str
    ) -> Path | None:
        """Return the path with the first line along a polyline that the car can drive, or None.

        Args:
            polyline: points of a route or path, `POINT_SPACING` apart, (n, 2) [m]; beyond the
                line's reach the path follows it unchanged.
            pose: x, y, yaw at which the path begins, (3,).
            source: method that found it, see `Path.source`.
        """
        cost, tightest = self.cost, 0.95 * self.car.max_curvature
        polyline = self._extend_past_goal(polyline)
        for line in lines_along(polyline, pose, cost, self.goal, tightest, self.config):
            if self._is_drivable(line):
                path = Path.through(np.vstack([line, polyline[len(line) :]]), source)
                return replace(path, drivable=min(len(line), len(path.points)))
        return None

    def price(self, path: Path, speed: float) -> float:
        """Return the price of a path: its driving time, weighted by the cost of the cells on it.

        Time is expressed as the distance driven at top speed [m].

        Args:
            path: path to price.
            speed: speed at the path's start [m/s].
        """
        car, points = self.car, path.points
        head = points[: max(2, min(path.drivable or 120, len(points)))]
        v = speeds(head, max(speed, SLOWEST), car.driving)
        slowness = np.ones(len(points))
        slowness[: len(head)] = car.v_max / np.maximum(v, SLOWEST)
        return self.cost.along(points, slowness)

    def _extend_past_goal(self, polyline: NDArray[np.float64]) -> NDArray[np.float64]:
        """Extend a polyline beyond the goal, up to an obstacle or the stopping distance.

        The goal may be passed at any speed, so the car need not brake for it.
        """
        if len(polyline) < 6 or math.dist(polyline[-1], self.goal) > 0.2:
            return polyline
        heading = polyline[-1] - polyline[-6]
        heading /= max(float(np.hypot(*heading)), 1e-9)
        count = math.ceil((self.car.stopping_distance + 0.5) / POINT_SPACING)
        on = polyline[-1] + POINT_SPACING * np.arange(1, count + 1)[:, None] * heading
        inside, rows, cols = self.cost.frame.locate(on)
        open_ = np.zeros(count, dtype=bool)
        open_[inside] = self.cost.room[rows, cols] >= self.cost.required + 0.1
        # The body reaches farther than its centre, and has to fit at the end, too.
        open_ &= self._fits(on + (self._offset + POINT_SPACING) * heading)
        return np.vstack([polyline, on[: count if open_.all() else int(np.argmin(open_))]])

    def _is_drivable(self, line: NDArray[np.float64]) -> bool:
        """Return whether the car can steer along a line, and its body fits."""
        if np.abs(curvatures(line)).max() > self.car.max_curvature:
            return False
        steps = np.diff(line, axis=0)
        steps *= self._offset / np.hypot(*steps.T)[:, None]
        # A car that starts too close to an obstacle must be able to leave.
        start = np.hypot(*(line[1:] - line[0]).T) < 0.45
        return all((start | self._fits(line[1:] + side * steps)).all() for side in (-1, 1))

    def _fits(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether a circle that covers half of the body fits at each point, (n,)."""
        out = np.ones(len(points), dtype=bool)
        inside, rows, cols = self.cost.frame.locate(points)
        out[inside] = self.cost.clearance[rows, cols] >= self.cost.required
        # Around the car, the risk map decides, whose cells are finer.
        inside, rows, cols = self.near.frame.locate(points)
        out[inside] = self.near.obstacle_distance[rows, cols] >= self._radius + BODY_MARGIN
        return out
