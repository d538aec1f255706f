"""People in the way of a simulated car: they walk between its scans, and are touched or not."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foresee.mapping.body import Body
from foresee.mapping.conventions import TICK
from foresee.mapping.scan import Scan
from sim import Lidar
from sim.episode import STANDSTILL
from sim.lidar import LidarConfig
from sim.people import RADIUS, People
from sim.world import World

PARTS = 20
"""Number of moments of a tick at which people and body are compared."""


class CrowdedLidar(Lidar):
    """A LIDAR that sees people, who walk on between its scans.

    Args:
        config: settings of the LIDAR.
        people: the people.
    """

    def __init__(self, config: LidarConfig, people: People) -> None:
        super().__init__(config)
        self.people = people
        self.places = list[NDArray[np.float64]]()
        """x, y of each person at each scan, (n, 2) [m]."""

    def scan(
        self,
        world: World,
        pose: ArrayLike,
        rng: np.random.Generator | None = None,
        discs: NDArray[np.float64] | None = None,
    ) -> Scan:
        """Take a scan, as `Lidar.scan` does, with the people."""
        if self.places:
            self.people.walk(TICK, np.asarray(pose)[:2])
        self.places.append(self.people.places)
        return super().scan(world, pose, rng, self.people.discs)


def first_touch(
    states: NDArray[np.float64], places: NDArray[np.float64], body: Body
) -> dict[str, Any] | None:
    """Return when the body first touches a person, and how fast it is then; None: it does not.

    Args:
        states: x, y, yaw, v of the car at each scan, (T, 4).
        places: x, y of each person at each scan, (T, n, 2) [m].
        body: body of the car.

    Returns:
        `at` [s], `speed` [m/s], `rest`: whether the car stood.
    """
    for tick in range(len(states) - 1):
        before, after = states[tick], states[tick + 1]
        turn = np.remainder(after[2] - before[2] + np.pi, 2.0 * np.pi) - np.pi
        for part in np.arange(PARTS) / PARTS:
            x, y, v = before[[0, 1, 3]] + part * (after - before)[[0, 1, 3]]
            yaw = before[2] + part * turn
            people = places[tick] + part * (places[tick + 1] - places[tick])
            cos, sin = np.cos(yaw), np.sin(yaw)
            local = abs((people - (x, y)) @ np.array([[cos, -sin], [sin, cos]]))
            off = np.hypot(*np.maximum(local - body.halves, 0.0).T)
            if (off < RADIUS).any():
                at = (tick + part) * TICK
                return {"at": float(at), "speed": abs(float(v)), "rest": bool(abs(v) < STANDSTILL)}
    return None
