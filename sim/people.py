"""People who walk about: the LIDAR sees them, but they are not in the true map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim.world import World

RADIUS = 0.25
"""Radius of a person [m]."""
SPEEDS = (0.4, 1.4)
"""Lowest and highest walking speed [m/s]."""
APART = 1.2
"""Distance that people keep from the robot's centre [m]; the robot may come nearer to them."""


class People:
    """Discs that walk straight up to an obstacle, and then in another direction.

    Args:
        world: the building.
        density: number of people per square metre of free space [1/m²].
        robot: x, y of the robot at the start, (2,) [m].
        rng: source of the people's places and walks.
        speeds: lowest and highest walking speed [m/s].
        apart: distance that people keep from the robot's centre as they walk [m]; 0: they do not
            look where the robot is.
    """

    def __init__(
        self,
        world: World,
        density: float,
        robot: NDArray[np.float64],
        rng: np.random.Generator,
        speeds: tuple[float, float] = SPEEDS,
        apart: float = APART,
    ) -> None:
        self._world, self._rng, self._apart = world, rng, apart
        frame = world.grid.frame
        cells = np.argwhere(world.clearance > RADIUS + frame.resolution)
        roomy = np.array(frame.origin) + (cells[:, ::-1] + 0.5) * frame.resolution
        roomy = roomy[np.hypot(*(roomy - robot).T) > APART]
        area = np.count_nonzero(world.grid.free) * frame.resolution**2
        count = rng.poisson(density * area) if len(roomy) else 0
        self.places = roomy[rng.integers(max(len(roomy), 1), size=count)]
        """x, y of each person, (n, 2) [m]."""
        self._headings = rng.uniform(-math.pi, math.pi, count)
        self._speeds = rng.uniform(*speeds, count)

    @property
    def discs(self) -> NDArray[np.float64]:
        """x, y, radius of each person, (n, 3) [m], for `Lidar.scan`."""
        return np.column_stack([self.places, np.full(len(self.places), RADIUS)])

    def walk(self, interval: float, robot: NDArray[np.float64]) -> None:
        """Let all people walk on.

        Args:
            interval: duration of the walk [s].
            robot: x, y of the robot, (2,) [m].
        """
        along = np.column_stack([np.cos(self._headings), np.sin(self._headings)])
        ahead = self.places + interval * self._speeds[:, None] * along
        near = np.hypot(*(ahead - robot).T)
        before = np.hypot(*(self.places - robot).T)
        free = self._roomy(ahead) & ((near > self._apart) | (near > before))
        self.places = np.where(free[:, None], ahead, self.places)
        # Drawn for all, so that no one's draw depends on what another meets.
        turned = self._rng.uniform(-math.pi, math.pi, len(free))
        self._headings = np.where(free, self._headings, turned)

    def _roomy(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        frame, clearance = self._world.grid.frame, self._world.clearance
        inside, rows, cols = frame.locate(places)
        roomy = inside.copy()
        roomy[inside] = clearance[rows, cols] > RADIUS + frame.resolution
        return roomy
