"""The course: the path that a car should be able to follow on from the end of a manoeuvre."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Scene, meets
from foresee.mapping.kernels import njit
from planner.motion.dynamics import pose_along
from planner.motion.path import POINT_SPACING, project
from planner.motion.pure_pursuit import steer


class Course(NamedTuple):
    """A path, and how `rejoins` follows it.

    Attributes:
        points: points of the path, (n, 2) [m].
        segment: index of the path's segment near which the car is.
        reach: number of segments within which a manoeuvre ends.
        look: distance of the point to aim at [m].
        curvature: curvature of the tightest arc [1/m].
        length: length of the way to test [m].
        near: distance from the path within which the car follows it again [m].
        spacing: distance between tested poses [m].
        scene: cells that the body must not meet on the way, and the body.
    """

    points: NDArray[np.float64]
    segment: int
    reach: int
    look: float
    curvature: float
    length: float
    near: float
    spacing: float
    scene: Scene


@njit(cache=True, nogil=True)
def rejoins(pose, course):  # type: ignore[no-untyped-def]
    """Return whether a car can follow a path from a pose without a contact, by pure pursuit.

    It can if it is near the path after `Course.length`, or once the nearest point of the path is
    its end, however far that is. Beyond the grid there is nothing that it could meet.

    Args:
        pose: x, y, yaw of the car at rest; further entries are ignored.
        course: `Course` to follow.
    """
    points, scene = course.points, course.scene
    rows, cols = scene.blocked.shape
    width, height = cols * scene.resolution, rows * scene.resolution
    body = math.hypot(scene.half_length, scene.half_width) + scene.resolution
    x, y, yaw = pose[0], pose[1], pose[2]
    first = course.segment
    segment, _, square = project(points, x, y, first - 5, first + course.reach)
    for _ in range(math.ceil(course.length / course.spacing)):
        if segment >= points.shape[0] - 3:
            return True
        target = min(segment + int(course.look / POINT_SPACING) + 1, points.shape[0] - 1)
        kappa = steer(x, y, yaw, points[target], course.curvature)
        x, y, yaw = pose_along(x, y, yaw, kappa, course.spacing)
        right, up = x - scene.origin[0], y - scene.origin[1]
        if min(right, up, width - right, height - up) < body:
            break
        if meets(scene, x, y, yaw):
            return False
        segment, _, square = project(points, x, y, segment - 3, segment + 12)
    return square < course.near * course.near
