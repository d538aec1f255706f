"""A canvas in coordinates that are turned and shifted, to draw a wing of a building at an angle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim.canvas import Canvas, Point


class TurnedCanvas(Canvas):
    """Draws on another canvas, in coordinates of its own.

    Args:
        canvas: the canvas that is drawn on.
        origin: the place of (0, 0) on it [m].
        yaw: direction of the x axis on it [rad].
    """

    def __init__(self, canvas: Canvas, origin: Point, yaw: float) -> None:
        self.canvas, self.origin, self.yaw = canvas, origin, yaw
        self.frame, self.free = canvas.frame, canvas.free
        self.x, self.y = canvas.x, canvas.y

    def box(self, centre: Point, size: Point, yaw: float = 0.0, free: bool = False) -> None:
        """Fill a rectangle of a size along and across its yaw [m, rad]; with `free`, carve it."""
        self.canvas.box(self.place(centre), size, yaw + self.yaw, free)

    def disc(self, centre: Point, radius: float, free: bool = False) -> None:
        """Fill a disc of a radius [m]; with `free`, carve it."""
        self.canvas.disc(self.place(centre), radius, free)

    def posts(self, points: NDArray[np.float64]) -> None:
        """Fill the cells in which points (n, 2) [m] lie."""
        self.canvas.posts(rotated(points, self.yaw) + self.origin)

    def is_free(self, x: float, y: float) -> bool:
        """Return whether a point [m] lies in a carved cell."""
        return self.canvas.is_free(*self.place((x, y)))

    def place(self, point: Point) -> Point:
        """Return where a point [m] lies on the canvas that is drawn on [m]."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y = point
        return self.origin[0] + cos * x - sin * y, self.origin[1] + sin * x + cos * y


def rotated(points: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Return points (n, 2) turned about (0, 0) by an angle [rad]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]))
