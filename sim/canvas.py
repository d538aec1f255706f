"""Canvas for buildings: free shapes are carved into solid ground, and objects put into them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from sim.world import World

WALL_CELLS = 3
"""Thickness of the walls around free space [cells]."""

Point = tuple[float, float]


class Canvas:
    """A rectangle of solid ground that is carved, with (0, 0) at its lower-left corner.

    Args:
        width: extent along x [m].
        height: extent along y [m].

    Attributes:
        frame: position and resolution of the cells.
        free: cells that are carved, (rows, columns).
        x: coordinates of the columns' centres, (columns,) [m].
        y: coordinates of the rows' centres, (rows,) [m].
    """

    def __init__(self, width: float, height: float) -> None:
        shape = (math.ceil(height / RESOLUTION), math.ceil(width / RESOLUTION))
        self.frame = GridFrame(RESOLUTION, (0.0, 0.0), shape)
        self.free = np.zeros(shape, dtype=np.bool_)
        self.x, self.y = self.frame.centres()

    def box(self, centre: Point, size: Point, yaw: float = 0.0, free: bool = False) -> None:
        """Fill a rectangle of a size along and across its yaw [m, rad]; with `free`, carve it."""
        cos, sin = abs(math.cos(yaw)), abs(math.sin(yaw))
        reach = 0.5 * (cos * size[0] + sin * size[1]), 0.5 * (sin * size[0] + cos * size[1])
        part, dx, dy = self._around(centre, reach)
        along = dx * math.cos(yaw) + dy * math.sin(yaw)
        across = dy * math.cos(yaw) - dx * math.sin(yaw)
        # Slightly enlarged, so that cells with their centre on an edge belong to the rectangle.
        inside = (abs(along) <= 0.5 * size[0] + 1e-9) & (abs(across) <= 0.5 * size[1] + 1e-9)
        self.free[part][inside] = free

    def disc(self, centre: Point, radius: float, free: bool = False) -> None:
        """Fill a disc of a radius [m]; with `free`, carve it."""
        part, dx, dy = self._around(centre, (radius, radius))
        self.free[part][dx**2 + dy**2 <= radius**2] = free

    def passage(self, start: Point, end: Point, width: float) -> None:
        """Carve a straight passage of a width [m], square at both ends."""
        length, yaw = math.dist(start, end), math.atan2(end[1] - start[1], end[0] - start[0])
        middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
        self.box(middle, (length, width), yaw, free=True)

    def room(self, low: Point, high: Point) -> None:
        """Carve an axis-aligned room between two corners [m]."""
        middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]))
        self.box(middle, (high[0] - low[0], high[1] - low[1]), free=True)

    def posts(self, points: NDArray[np.float64]) -> None:
        """Fill the cells in which points (n, 2) [m] lie; others are ignored."""
        rows, cols = self.frame.shape
        col, row = np.floor(points.T / RESOLUTION).astype(np.intp)
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        self.free[row[inside], col[inside]] = False

    def is_free(self, x: float, y: float) -> bool:
        """Return whether a point [m] lies in a carved cell."""
        return self.frame.contains(x, y) and bool(self.free[self.frame.cell(x, y)])

    def world(self, name: str) -> World:
        """Return the building: FREE where carved, OCCUPIED walls around, UNKNOWN beyond them."""
        solid = ~self.free
        near = binary_dilation(self.free, np.ones((3, 3), dtype=np.bool_), iterations=WALL_CELLS)
        cells = np.where(self.free, np.int8(FREE), np.int8(UNKNOWN))
        cells[solid & near] = OCCUPIED
        rows, cols = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
        kept = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        frame = GridFrame(RESOLUTION, (0.0, 0.0), (kept.shape[0], kept.shape[1]))
        return World(name, Grid(frame, np.ascontiguousarray(kept)))

    def _around(
        self, centre: Point, reach: Point
    ) -> tuple[tuple[slice, slice], NDArray[np.float64], NDArray[np.float64]]:
        """Return the cells within reach of a point, and their offsets x (1, n) and y (m, 1) [m].

        The reach is given along x and along y [m]. The rim of the canvas is left out: it is
        as thick as a wall, and nothing is carved in it.
        """
        rows, cols = self.frame.shape
        row, col = self.frame.cell(centre[0] - reach[0], centre[1] - reach[1])
        row_end, col_end = self.frame.cell(centre[0] + reach[0], centre[1] + reach[1])
        part = (
            slice(max(row, WALL_CELLS), max(min(row_end + 1, rows - WALL_CELLS), WALL_CELLS)),
            slice(max(col, WALL_CELLS), max(min(col_end + 1, cols - WALL_CELLS), WALL_CELLS)),
        )
        return part, (self.x[part[1]] - centre[0])[None, :], (self.y[part[0]] - centre[1])[:, None]


def largest_piece(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the largest connected piece of the free cells, (rows, columns).

    Raises:
        ValueError: if no cell is free.
    """
    pieces, count = label(free)
    if not count:
        raise ValueError("the building has no free space; a map must have free cells")
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return np.asarray(pieces == sizes.argmax())
