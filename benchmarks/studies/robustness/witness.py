"""A witness: whether what is observed in a static world, with an exact LIDAR, is true."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import OccupancyGrid, paste
from sim.lidar import Lidar
from sim.world import World

SCANS = 40
"""Number of scans from corners of cells."""
WINDOW = 5.0
"""Side of the square in which these scans are used [m]."""


class Witness:
    """Takes note of all that was observed wrongly.

    Args:
        world: true map.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self._free = np.zeros(world.grid.frame.shape, dtype=bool)
        self._occupied, self._lost = self._free.copy(), self._free.copy()

    def compare(self, known: OccupancyGrid, x: float, y: float) -> None:
        """Compare the observed map with the truth, and with what was observed earlier.

        Args:
            known: observed map.
            x: position of the car, in whose window the map has changed [m].
            y: the same [m].
        """
        here, seen = self._seen(known, x, y)
        self._lost[here] |= self._free[here] & (seen >= 0)
        self._note(here, seen)

    def scan_from_corners(self, lidar: Lidar, rng: np.random.Generator) -> None:
        """Take scans from corners of cells, at multiples of 45°, and compare each with the truth.

        Each is for a map of its own, in which a single false observation shows; take them after the
        drive.

        Args:
            lidar: LIDAR at the centre of the car.
            rng: source of the places.
        """
        frame, solid = self.world.grid.frame, self.world.solid
        free = ~(solid[1:, 1:] | solid[:-1, 1:] | solid[1:, :-1] | solid[:-1, :-1])
        corners = np.argwhere(free)[:, ::-1] + 1
        for corner in corners[rng.integers(len(corners), size=SCANS)]:
            x, y = (float(value) for value in frame.origin + corner * frame.resolution)
            pose = (x, y, 0.25 * math.pi * float(rng.integers(8)))
            known = OccupancyGrid(frame.square(x, y, WINDOW), WINDOW)
            known.integrate(lidar.scan(self.world, pose), pose)
            self._note(*self._seen(known, x, y))

    def _seen(
        self, known: OccupancyGrid, x: float, y: float
    ) -> tuple[tuple[slice, slice], NDArray[np.int8]]:
        """Return the cells of the true map in the window, and their observed log-odds."""
        window = known.frame.square(x, y, known.window)
        here, there = self.world.grid.frame.overlap(window)
        return here, paste(known.frame, known.log_odds, window, np.int8(0))[there]

    def _note(self, here: tuple[slice, slice], seen: NDArray[np.int8]) -> None:
        self._free[here] |= seen < 0
        self._occupied[here] |= seen > 0

    @property
    def false_cells(self) -> dict[str, int]:
        """Number of cells that were observed wrongly at any time, by kind.

        `solid_as_free`: solid cells that counted as free; `free_as_occupied`: free cells that
        counted as occupied; `lost_free`: cells that counted as free, and later did not.
        """
        solid = self.world.solid
        return {
            "solid_as_free": int((self._free & solid).sum()),
            "free_as_occupied": int((self._occupied & ~solid).sum()),
            "lost_free": int(self._lost.sum()),
        }
