"""Walks through buildings: a point follows routes to a goal, without a car's dynamics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import GOAL_RADIUS
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.polyline import arc_length, points_at
from planner.guide.route import find_route
from planner.risk.cost_map import CostMap
from sim import Lidar
from sim.task import Task

STEP = 0.4
"""Distance from one scan to the next [m]."""
REPLAN = 2
"""Number of scans from one route to the next."""
WINDOW = 5.0
"""Side of the square in which the LIDAR is used, by default [m]."""
Place = tuple[float, float]
Router = Callable[[int, OccupancyGrid, Place], NDArray[np.float64] | None]
"""Function that returns the route (n, 2) [m] to the goal, or None: tick, observed map, position."""


def walk(
    task: Task, route_to_goal: Router, longest: float, window: float = WINDOW
) -> Iterator[tuple[OccupancyGrid, NDArray[np.float64]]]:
    """Walk to the goal, or until there is no route, and yield the observed map and each pose (3,).

    The map is the same object each time, and changes; copy what must not change.

    Args:
        task: building, start and goal.
        route_to_goal: function that chooses the route, asked every `REPLAN` steps.
        longest: distance after which the walk ends [m].
        window: side of the square in which the LIDAR is used [m].
    """
    known, lidar = task.blank(window), Lidar()
    known.cover(known.frame.square(*task.goal, window))
    pose = np.array(task.start)
    task.mark_start(known, CarLimits().body)
    route = np.empty((0, 2))
    for tick in range(math.ceil(longest / STEP)):
        known.integrate(lidar.scan(task.world, pose), pose)
        yield known, pose
        at = (float(pose[0]), float(pose[1]))
        if math.dist(at, task.goal) < GOAL_RADIUS:
            return
        if tick % REPLAN == 0:
            fresh = route_to_goal(tick, known, at)
            if fresh is None:
                return
            route = fresh
        pose, route = _advanced(route)


def walked(task: Task, longest: float, window: float = WINDOW) -> NDArray[np.float64]:
    """Walk along the planner's routes without prediction, and return the poses (n, 3).

    Args:
        task: building, start and goal.
        longest: distance after which the walk ends [m].
        window: side of the square in which the LIDAR is used [m].
    """

    def route_to_goal(tick: int, known: OccupancyGrid, at: Place) -> NDArray[np.float64] | None:
        cost = CostMap.build(known, None, CarLimits().body.half_width)
        return find_route(cost, at, task.goal)

    return np.array([pose for _, pose in walk(task, route_to_goal, longest, window)])


def _advanced(route: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pose after a step along a route (n, 2), and the rest of the route."""
    along = arc_length(route)
    here = min(STEP, float(along[-1]))
    (place,) = points_at(route, [here])
    rest = np.vstack([place, route[along > here]])
    ahead = (rest[1] if len(rest) > 1 else place) - route[0]
    return np.array([*place, math.atan2(ahead[1], ahead[0])]), rest
