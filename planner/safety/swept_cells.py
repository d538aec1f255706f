"""The cells that a body covers along a plan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.motion.plan import Plan
from predictor.mapping.body import Body, covered
from predictor.mapping.grid import GridFrame
from predictor.mapping.kernels import njit


def swept_cells(
    plan: Plan, dt: float, body: Body, frame: GridFrame, among: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the cells `among` (rows, columns) that a body meets on a plan."""
    poses = plan.poses(dt, 2 * frame.resolution)
    met = _sweep(among, frame.resolution, frame.origin, poses, body.half_length, body.half_width)
    rows, cols = np.nonzero(met)
    return rows, cols


@njit(cache=True, nogil=True)
def _sweep(among, resolution, origin, poses, half_length, half_width):  # type: ignore[no-untyped-def]
    met = np.zeros(among.shape, dtype=np.bool_)
    for i in range(poses.shape[0]):
        cells = covered(
            among.shape,
            resolution,
            origin,
            poses[i, 0],
            poses[i, 1],
            poses[i, 2],
            half_length,
            half_width,
        )
        for j in range(cells.shape[0]):
            row, col = cells[j, 0], cells[j, 1]
            if among[row, col]:
                met[row, col] = True
    return met
