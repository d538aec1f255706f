"""The world: the true map of a building, and the arrays that rays and collision tests read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame, paste
from foresee.mapping.kernels import njit


@dataclass(frozen=True, eq=False)
class World:
    """The true map of a building.

    One grid serves rays and collision tests alike: OCCUPIED cells stop both. UNKNOWN cells and all
    that lies outside are solid to the car's body, and end a ray without a return.

    Attributes:
        name: name of the building in reports.
        grid: the true map.
    """

    name: str
    grid: Grid

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """Cells that the body may not touch: all that are not FREE, (rows, columns)."""
        return np.asarray(self.grid.cells != FREE)

    @cached_property
    def surface(self) -> NDArray[np.bool_]:
        """Occupied cells with a free one among their eight neighbours, (rows, columns).

        A ray can hit only these. Cells that are neither free nor surface can never be observed.
        """
        return np.asarray(
            self.grid.occupied & binary_dilation(self.grid.free, np.ones((3, 3), dtype=bool))
        )

    def truth(self, frame: GridFrame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return free cells and surface cells in a frame on this lattice, (rows, columns) each."""
        free, surface = (
            paste(self.grid.frame, cells, frame, np.bool_(False))
            for cells in (self.grid.free, self.surface)
        )
        return free, surface

    @cached_property
    def clearance(self) -> NDArray[np.float64]:
        """Distance from a cell's centre to that of the nearest solid cell [m], (rows, columns)."""
        free = np.pad(~self.solid, 1)
        distance = np.asarray(distance_transform_edt(free), dtype=np.float64)
        return distance[1:-1, 1:-1] * self.grid.frame.resolution

    @cached_property
    def skips(self) -> NDArray[np.uint8]:
        """Sides of the squares that a ray may skip from each cell, from `empty_squares`."""
        return empty_squares(self.solid)


def sealed(world: World) -> World:
    """Return a building with the unknown cells between free space and a wall made occupied.

    Maps that robots have built often have one unknown cell before a wall. It would end a ray
    without a return, and make the building invisible. Collisions of the body stay the same.
    """
    around = np.ones((3, 3), dtype=bool)
    grid = world.grid
    sliver = (
        grid.unknown & binary_dilation(grid.free, around) & binary_dilation(grid.occupied, around)
    )
    cells = np.where(sliver, np.int8(OCCUPIED), grid.cells)
    return World(world.name, Grid(grid.frame, cells))


@njit(cache=True, nogil=True)
def empty_squares(solid):  # type: ignore[no-untyped-def]
    """Compute the side of the largest empty square with each cell as its corner, by quadrant.

    Quadrant 2·(dy < 0) + (dx < 0) holds the squares that reach along the signs of dx and dy. It is
    a plane of its own, since a ray stays in one quadrant, and neighbouring beams then read
    neighbouring bytes.

    Args:
        solid: solid cells, (rows, columns) bool.

    Returns:
        Sides of the squares, at most 255, (4, rows + 2, columns + 2) uint8 [cells]; 0 in solid
        cells. A solid ring around the map spares the rays a test of bounds.
    """
    rows, cols = solid.shape
    sides = np.zeros((4, rows + 2, cols + 2), dtype=np.uint8)
    for quadrant in range(4):
        dx = -1 if quadrant & 1 else 1
        dy = -1 if quadrant & 2 else 1
        plane = sides[quadrant]
        for i in range(rows):
            row = 1 + i if dy < 0 else rows - i
            for j in range(cols):
                col = 1 + j if dx < 0 else cols - j
                if not solid[row - 1, col - 1]:
                    side = min(plane[row + dy, col], plane[row, col + dx])
                    side = min(side, plane[row + dy, col + dx])
                    plane[row, col] = min(np.int64(side) + 1, 255)
    return sides
