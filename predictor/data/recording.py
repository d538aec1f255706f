"""A drive being recorded: frame after frame, from what has been seen so far."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from predictor.data.frames import CROP, RESOLUTION, SIDE, codes_of
from predictor.mapping.grid import Grid, GridFrame, OccupancyGrid

WINDOW = 5.0
"""Side of the square that the confined LIDAR writes into [m]."""


class Recording:
    """Collects the frames of one trajectory.

    Args:
        frame: where the building's map lies.
        truth: its codes, (rows, columns): 0 free, 1 surface, 2 never observable.
    """

    def __init__(self, frame: GridFrame, truth: NDArray[np.uint8]) -> None:
        self.frame, self.truth = frame, truth
        self._rows: dict[str, list[NDArray]] = {
            name: []
            for name in ("estimated", "remembered", "states", "actions", "times", "corners")
        }

    def __len__(self) -> int:
        return len(self._rows["times"])

    def add(
        self,
        whole: OccupancyGrid,
        near: OccupancyGrid,
        state: NDArray[np.float64],
        action: NDArray[np.float64],
        time: float,
    ) -> None:
        """Take a frame.

        Args:
            whole: what all of the LIDAR has seen so far.
            near: what it has seen within the window.
            state: x, y, yaw, v, (4,).
            action: acceleration, curvature, (2,).
            time: [s].
        """
        square = self.frame.square(float(state[0]), float(state[1]), SIDE * RESOLUTION)
        inset = (SIDE - CROP) // 2
        inner = slice(inset, inset + CROP)
        rows = self._rows
        rows["estimated"].append(_codes(whole.crop(square))[inner, inner])
        rows["remembered"].append(_codes(near.crop(square)))
        rows["states"].append(np.asarray(state, dtype=np.float64))
        rows["actions"].append(np.asarray(action, dtype=np.float64))
        rows["times"].append(np.array(time, dtype=np.float64))
        rows["corners"].append(np.array(self.frame.offset(square), dtype=np.int32))

    def arrays(self) -> dict[str, NDArray]:
        """All that a trajectory's file holds."""
        return {name: np.stack(values) for name, values in self._rows.items()} | {
            "map": self.truth,
            "origin": np.array(self.frame.origin),
        }


def _codes(grid: Grid) -> NDArray[np.uint8]:
    return codes_of(grid.cells)
