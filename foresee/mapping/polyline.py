"""Polylines: the length along them, and points at given lengths."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def arc_length(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the length of a polyline from its first point to each point [m], (n,).

    Args:
        points: x and y of each point in the first two columns, (n, 2 or more) [m].
    """
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T)))


def points_at(
    points: NDArray[np.floating], distances: NDArray[np.floating] | Sequence[float]
) -> NDArray[np.float64]:
    """Return the points of a polyline at some distances from its first point, (k, 2) [m].

    Args:
        points: x and y of each point in the first two columns, (n, 2 or more) [m].
        distances: distances along the polyline, (k,); beyond its ends they give these ends [m].
    """
    along = arc_length(points)
    return np.column_stack([np.interp(distances, along, points[:, axis]) for axis in (0, 1)])
