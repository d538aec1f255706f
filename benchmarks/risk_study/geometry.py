"""A test of a drive against the true map, other than those of the planner and the simulator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.body import Body
from predictor.mapping.grid import GridFrame

SPACING = 0.02
"""Distance of the points of the body that are tested, and between two of its places [m]."""
TOLERANCE = 0.01
"""The body is tested this much smaller on each side, since its places between two recorded states
are interpolated on a straight line [m]. A corner of a cell can lie between points of the body, so
that a contact may be missed that is up to 0.025 m deep."""


def touches(
    states: NDArray[np.float64], solid: NDArray[np.bool_], frame: GridFrame, body: Body
) -> bool:
    """Return whether the body has touched something solid, or left the map, on a drive.

    Args:
        states: x, y, yaw, v at the ends of the ticks, (T+1, 4).
        solid: cells that are not free in the true map, (rows, columns).
        frame: of the map.
        body: of the car.
    """
    length, width = body.half_length - TOLERANCE, body.half_width - TOLERANCE
    along = np.linspace(-length, length, int(np.ceil(2 * length / SPACING)) + 1)
    across = np.linspace(-width, width, int(np.ceil(2 * width / SPACING)) + 1)
    a, b = (one.ravel() for one in np.meshgrid(along, across))
    for place in _between(states):
        cos, sin = np.cos(place[2]), np.sin(place[2])
        x, y = place[0] + cos * a - sin * b, place[1] + sin * a + cos * b
        cols = np.floor((x - frame.origin[0]) / frame.resolution).astype(int)
        rows = np.floor((y - frame.origin[1]) / frame.resolution).astype(int)
        if min(rows.min(), cols.min()) < 0:
            return True
        if rows.max() >= solid.shape[0] or cols.max() >= solid.shape[1]:
            return True
        if solid[rows, cols].any():
            return True
    return False


def _between(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x, y, yaw of places at most `SPACING` apart along the states, (n, 3)."""
    places = np.column_stack([states[:, :2], np.unwrap(states[:, 2])])
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places[:, :2], axis=0).T))])
    at = np.append(np.arange(0.0, gone[-1], SPACING), gone[-1])
    return np.column_stack([np.interp(at, gone, places[:, i]) for i in range(3)])
