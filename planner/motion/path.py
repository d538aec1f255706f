"""Paths that the MPC follows: evenly spaced points, projections, and references for its cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.kernels import njit

SPACING = 0.1
"""Distance between the points of a path [m]."""
NEAR_END = 3.0
"""Length of the last part of a path, which the MPC follows more closely [m]."""


@dataclass(frozen=True, eq=False)
class Path:
    """A path that the car is to follow.

    Attributes:
        points: points of the path, (n, 2) [m], `SPACING` apart.
        source: method that found the path. "route": a smooth line along Dijkstra's route; "hybrid":
            hybrid A*; "ompl": OMPL; "dijkstra": the route itself, which the car may not be able to
            drive; "given": the prescribed route.
        drivable: number of points, from the first on, that lie on curves that the car can drive.
    """

    points: NDArray[np.float64]
    source: str
    drivable: int = 0

    @classmethod
    def through(cls, vertices: NDArray[np.float64], source: str) -> Path:
        """Return the path along a polyline (n, 2) [m], resampled at `SPACING`."""
        vertices = np.asarray(vertices, dtype=np.float64)
        steps = np.hypot(*np.diff(vertices, axis=0).T) if len(vertices) > 1 else np.zeros(0)
        keep = np.concatenate([[True], steps > 1e-9])
        vertices = vertices[keep]
        along = np.concatenate([[0.0], np.cumsum(steps[keep[1:]])])
        if len(vertices) == 1:
            return cls(np.repeat(vertices, 2, axis=0), source)
        stations = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / SPACING) + 1))
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


@njit(cache=True, nogil=True)
def references(points, start, states, reach, progress, contour, final, heading):  # type: ignore[no-untyped-def]
    """Compute the reference of each state on the path, for `dynamics.stage_functions`.

    Progress is the arc length of the projection; its gradient is the path's tangent. Beyond the
    path's end, states are pulled towards its last point. Each state is projected near the
    projection of the state before, so that a path that crosses itself is followed in order.

    Args:
        points: points of the path, evenly spaced, (n, 2) [m].
        start: index of the segment near which the first state is projected.
        states: x, y, yaw, v of the states, (m, 4).
        reach: number of segments that one step may advance.
        progress: reward for a metre of progress.
        contour: weight w of the cost w/2 · d², with the distance d from the path [m].
        final: the same weight at the last state, and at the end of the path.
        heading: cost of 1 - cos(heading error) at the last state.

    Returns:
        References (m, 9), and the cost of each state, (m,).
    """
    count = states.shape[0]
    out = np.zeros((count, 9))
    costs = np.empty(count)
    last = points.shape[0] - 2
    spacing = math.hypot(points[1, 0] - points[0, 0], points[1, 1] - points[0, 1])
    here = start
    for k in range(count):
        x, y = states[k, 0], states[k, 1]
        here, t, square = project(points, x, y, here - reach // 2, here + reach)
        ax, ay = points[here, 0], points[here, 1]
        dx, dy = points[here + 1, 0] - ax, points[here + 1, 1] - ay
        length = max(math.hypot(dx, dy), 1e-9)
        tx, ty = dx / length, dy / length
        out[k, 0], out[k, 1] = ax + t * dx, ay + t * dy
        # At the path's end precision counts: a car that misses the goal has to turn round.
        left = (last + 1 - here - t) * spacing
        weight = contour + (final - contour) * max(0.0, 1.0 - left / NEAR_END)
        if k == count - 1:
            weight = final
        costs[k] = -progress * (here + t) * spacing + 0.5 * weight * square
        if here == last and t >= 1.0:
            out[k, 4] = out[k, 6] = weight
        else:
            out[k, 2], out[k, 3] = -progress * tx, -progress * ty
            out[k, 4] = weight * ty * ty
            out[k, 5] = -weight * tx * ty
            out[k, 6] = weight * tx * tx
        if k == count - 1 and here < last:
            out[k, 7], out[k, 8] = math.atan2(ty, tx), heading
            costs[k] += heading * (1.0 - math.cos(states[k, 2] - out[k, 7]))
    return out, costs
