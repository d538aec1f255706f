"""The calibration of a network's greys: the probabilities of free and of occupied for each grey.

For each of LEVELS levels of grey, from occupied (-1) over unknown (0) to free (+1), the
probabilities are the shares of cells that are truly free and truly occupied, made monotone by
isotonic regression (Barlow et al. 1972; Zadrozny and Elkan 2002): p_free rises with the grey,
p_occupied falls. p_free + p_occupied never exceeds 1, since the shares do not, and isotonic
regression with fixed weights is monotone in its values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

LEVELS = 511
"""Number of levels of grey; odd, so that one of them is exactly 0, unknown."""


def level_of(grey: NDArray[np.floating]) -> NDArray[np.intp]:
    """Return the level of each grey in [-1, 1], any shape."""
    return np.rint((grey + 1.0) * (0.5 * (LEVELS - 1))).astype(np.intp)


def literal() -> NDArray[np.float64]:
    """Return the probabilities before any fit, (2, LEVELS): p_free = grey, p_occupied = -grey."""
    grey = np.linspace(-1.0, 1.0, LEVELS)
    return np.stack([np.maximum(grey, 0.0), np.maximum(-grey, 0.0)])


def fitted(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Fit the probabilities of free and of occupied at each level, (2, LEVELS).

    Args:
        counts: number of cells at each level that are truly free, occupied, neither, (LEVELS, 3).
    """
    # One more of each (Laplace), so that no probability is 0 or 1 and no level is undefined.
    cells = counts + 1.0
    weights = cells.sum(axis=1)
    share = cells / weights[:, None]
    free = isotonic_regression(share[:, 0], weights=weights).x
    occupied = isotonic_regression(share[:, 1], weights=weights, increasing=False).x
    return np.stack([free, occupied])


def counted(
    grey: NDArray[np.floating], truth: NDArray[np.uint8], unseen: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Count unobserved cells by level of grey and by true class, (LEVELS, 3).

    Args:
        grey: greys in [-1, 1], any shape.
        truth: codes 0 free, 1 occupied, 2 neither; the same shape.
        unseen: which cells are unobserved; the same shape.
    """
    both = 3 * level_of(grey[unseen]) + truth[unseen]
    return np.bincount(both, minlength=3 * LEVELS).reshape(LEVELS, 3).astype(np.int64)
