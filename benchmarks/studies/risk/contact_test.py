"""A test of drives for contacts on the true map, independent of planner and simulator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.grid import GridFrame

STEP = 0.02
"""Distance between two tested points of the body, and between two poses of the body [m]."""
TOLERANCE = 0.01
"""Distance by which the tested body is smaller on each side [m], since poses between two recorded
states are interpolated on a straight line. A corner of a cell may lie between two tested points of
the body, so that a contact up to 0.025 m deep may be missed."""


def touches(
    states: NDArray[np.float64], solid: NDArray[np.bool_], frame: GridFrame, body: Body
) -> bool:
    """Return whether the body has touched a solid cell, or left the map, on a drive.

    Args:
        states: x, y, yaw, v at the start and at the end of each tick, (T+1, 4).
        solid: cells that are not free in the true map, (rows, columns).
        frame: frame of the map.
        body: body of the car.
    """
    length, width = body.half_length - TOLERANCE, body.half_width - TOLERANCE
    along = np.linspace(-length, length, int(np.ceil(2 * length / STEP)) + 1)
    across = np.linspace(-width, width, int(np.ceil(2 * width / STEP)) + 1)
    a, b = (grid.ravel() for grid in np.meshgrid(along, across))
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
    """Return poses x, y, yaw at most `STEP` apart along the states, (n, 3)."""
    places = np.column_stack([states[:, :2], np.unwrap(states[:, 2])])
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places[:, :2], axis=0).T))])
    at = np.append(np.arange(0.0, driven[-1], STEP), driven[-1])
    return np.column_stack([np.interp(at, driven, places[:, i]) for i in range(3)])
