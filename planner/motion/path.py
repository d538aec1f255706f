"""Paths that the MPC follows: evenly spaced points, and projections on them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.kernels import njit

POINT_SPACING = 0.1
"""Distance between the points of a path [m]."""


@dataclass(frozen=True, eq=False)
class Path:
    """A path that the car is to follow.

    Attributes:
        points: points of the path, (n, 2) [m], `POINT_SPACING` apart.
        source: method that found the path. "route": a smooth line along Dijkstra's route; "hybrid":
            hybrid A*; "ompl": OMPL; "dijkstra": the route itself, which the car may not be able to
            drive; "given": a prescribed route; "plan": the way of a plan.
        drivable: number of points, from the first on, that lie on curves that the car can drive.
    """

    points: NDArray[np.float64]
    source: str
    drivable: int = 0

    @classmethod
    def through(cls, vertices: NDArray[np.float64], source: str) -> Path:
        """Return the path along a polyline (n, 2) [m], resampled at `POINT_SPACING`."""
        vertices = np.asarray(vertices, dtype=np.float64)
        steps = np.hypot(*np.diff(vertices, axis=0).T) if len(vertices) > 1 else np.zeros(0)
        keep = np.concatenate([[True], steps > 1e-9])
        vertices = vertices[keep]
        along = np.concatenate([[0.0], np.cumsum(steps[keep[1:]])])
        if len(vertices) == 1:
            return cls(np.repeat(vertices, 2, axis=0), source)
        stations = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / POINT_SPACING) + 1))
        points = np.column_stack([np.interp(stations, along, vertices[:, i]) for i in (0, 1)])
        return cls(points, source)


@njit(cache=True, nogil=True)
def project(points, x, y, first, last):  # type: ignore[no-untyped-def]
    """Find the point of a polyline that is closest to x, y, on its segments `first` to `last`.

    Returns:
        Index of the segment, fraction along it in [0, 1], and squared distance from it [m²].
    """
    best, where, share = np.inf, first, 0.0
    for i in range(max(first, 0), min(last, points.shape[0] - 2) + 1):
        ax, ay = points[i, 0], points[i, 1]
        dx, dy = points[i + 1, 0] - ax, points[i + 1, 1] - ay
        square = dx * dx + dy * dy
        t = 0.0
        if square > 0:
            t = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
        px, py = x - ax - t * dx, y - ay - t * dy
        distance = px * px + py * py
        if distance < best - 1e-12:
            best, where, share = distance, i, t
    return where, share, best
