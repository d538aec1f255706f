"""Resampling of a map to another resolution."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame

Index = slice | NDArray[np.intp]


def resampled(grid: Grid, resolution: float) -> tuple[Grid, Index, Index]:
    """Resample a map to another resolution.

    If several cells become one, occupied wins over unknown, and unknown over free.

    Args:
        grid: map.
        resolution: side of the new cells [m].

    Returns:
        The new map; and indices of its rows and of its columns, one for each row and each column of
        the old map.
    """
    ratio = resolution / grid.frame.resolution
    if abs(ratio - 1.0) < 1e-6:
        return grid, slice(None), slice(None)
    rank = grid.unknown + np.int8(2) * grid.occupied
    rows, cols = (((np.arange(n) + 0.5) / ratio).astype(np.intp) for n in rank.shape)
    there = [((np.arange(back[-1] + 1) + 0.5) * ratio).astype(np.intp) for back in (rows, cols)]
    rank = maximum_filter(rank, max(1, math.ceil(ratio - 1e-6)), mode="nearest")
    rank = rank[
        np.minimum(there[0], rank.shape[0] - 1)[:, None],
        np.minimum(there[1], rank.shape[1] - 1),
    ]
    cells = np.array([FREE, UNKNOWN, OCCUPIED], dtype=np.int8)[rank]
    return Grid(GridFrame(resolution, grid.frame.origin, cells.shape), cells), rows, cols
