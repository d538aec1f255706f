"""A sham predictor, as a control: its probabilities of free cells are those of another building."""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from predictor.compact import Compact
from predictor.data.samples import quarters
from predictor.mapping.grid import Grid, OccupancyGrid
from predictor.prediction import Prediction
from sim.families import generate
from sim.lidar import Lidar
from sim.task import sample_task

PLACES = 20
"""Number of places in the other building whose predictions are used."""
FAMILY, SEED = "corridor", 5_900_000
"""Family and seed of the other building."""


class Sham:
    """Predicts with the shipped network, but with p_free and confidence from another building.

    A calibration that was made for the network must not hold for it; if it did, the study could not
    show anything.
    """

    def __init__(self) -> None:
        self._compact = Compact()
        self.context_side = self._compact.context_side

    def predict(
        self, known: Grid, pose: NDArray[np.float64], around: Grid | None = None
    ) -> Prediction:
        """Return a prediction with the p_free and the confidence at a place in another building.

        These are rotated by quarter turns, so that the car faces the same way in both.
        """
        mine = self._compact.predict(known, pose, around)
        other, place = _questions()[zlib.crc32(known.cells.tobytes()) % PLACES]
        crop = other.crop(other.frame.square(float(place[0]), float(place[1]), known.frame.size[0]))
        if crop.frame.shape != known.frame.shape or len(set(known.frame.shape)) > 1:
            raise ValueError(f"a window of {known.frame.shape} cells is no square around the car")
        theirs = self._compact.predict(crop, place)
        turns = quarters(float(pose[2])) - quarters(float(place[2]))
        p_free, confidence = (
            np.where(known.unknown, np.rot90(their, -turns), my)
            for their, my in (
                (theirs.p_free, mine.p_free),
                (theirs.confidence, mine.confidence),
            )
        )
        p_occupied = np.minimum(mine.p_occupied, 1.0 - p_free)
        return replace(mine, p_free=p_free, p_occupied=p_occupied, confidence=confidence)


@lru_cache
def _questions() -> list[tuple[OccupancyGrid, NDArray[np.float64]]]:
    """Return the map that one scan gives, and the pose, at places along a route in the building."""
    task = sample_task(generate(FAMILY, SEED), SEED)
    lidar, rng = Lidar(), np.random.default_rng(SEED)
    ways = np.diff(task.waypoints, axis=0, prepend=[task.start[:2]])
    poses = np.column_stack([task.waypoints, np.arctan2(ways[:, 1], ways[:, 0])])
    found = []
    for number in np.linspace(1, len(poses) - 1, PLACES).astype(int):
        pose = poses[number]
        known = task.blank(5.0)
        known.integrate(lidar.scan(task.world, np.array([*pose, 0.0]), rng), pose)
        found.append((known, pose))
    return found
