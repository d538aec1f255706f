"""One frame at one expansion: the observed and the true square, prepared for scoring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import Grid, GridFrame
from predictor.data.frames import SIDE, Frames
from predictor.data.squares import NOTHING, TERNARY, decode_cells
from predictor.scoring.images import beyond_crop
from predictor.scoring.scores import cell_rings


@dataclass(frozen=True, eq=False)
class ScoredSquare:
    """A frame at an expansion, with the maps and masks for scoring.

    Attributes:
        crop: map of the 5 m crop as observed by the whole LIDAR, unknown around it: the input of
            the paper's networks.
        window: map of the square as observed by a LIDAR that is used within its 5 m window only:
            the input of a planner.
        pose: x, y, yaw of the car, (3,) [m, m, rad]; x and y are the middle of the square, which
            is at most half a cell from the car.
        truth: codes of the true map, (n, n).
        image: ternary image of the true map, (n, n).
        ring: ring of each cell as in `predictor.scoring.scores.cell_rings`, the same for all
            predictors, (n, n); -1: observed in the crop or in the window.
        unseen: unobserved cells outside of the crop, (n, n).
    """

    crop: Grid
    window: Grid
    pose: NDArray[np.float64]
    truth: NDArray[np.uint8]
    image: NDArray[np.float64]
    ring: NDArray[np.int8]
    unseen: NDArray[np.bool_]

    @classmethod
    def of(cls, frames: Frames, index: int, expansion: float) -> ScoredSquare:
        """Return the square around a frame.

        Raises:
            FramesError: if there is no square of this expansion.
        """
        square = frames.square(index, expansion)
        crop, window, n = square.crop, square.window, len(square.truth)
        row, col = frames.corners[index] + (SIDE - n) // 2
        x, y = frames.origins[frames.trajectory[index]] + RESOLUTION * np.array([col, row])
        frame = GridFrame(RESOLUTION, (float(x), float(y)), (n, n))
        middle = RESOLUTION * n / 2
        seen = Grid(frame, decode_cells(np.where(window == NOTHING, crop, window)))
        ring = cell_rings(seen)
        return cls(
            crop=Grid(frame, decode_cells(crop)),
            window=Grid(frame, decode_cells(window)),
            pose=np.array([x + middle, y + middle, frames.states[index, 2]]),
            truth=square.truth,
            image=TERNARY[square.truth],
            ring=ring,
            unseen=(ring >= 0) & (beyond_crop(n) > 0),
        )
