"""What a grey means: from a network's grey image to probabilities.

At each of LEVELS levels of grey, from occupied (-1) over not known (0) to free (+1), the share of
cells that were truly free and truly occupied, made monotone by isotonic regression (Barlow et al.
1972; Zadrozny and Elkan 2002): p_free rises with the grey, p_occupied falls. Of two regressions
with the same weights the one of smaller values is nowhere larger, and the share of free cells is at
most 1 less that of occupied ones; so p_free + p_occupied never exceeds 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

LEVELS = 511
"""Of grey that are told apart: odd, so that one of them is not known, 0."""


def level_of(grey: NDArray[np.floating]) -> NDArray[np.intp]:
    """The level of each grey in [-1, 1], any shape."""
    return np.rint((grey + 1.0) * (0.5 * (LEVELS - 1))).astype(np.intp)


def literal() -> NDArray[np.float64]:
    """Greys taken at their word, (2, LEVELS): p_free is what is above 0, p_occupied below."""
    grey = np.linspace(-1.0, 1.0, LEVELS)
    return np.stack([np.maximum(grey, 0.0), np.maximum(-grey, 0.0)])


def fitted(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Probabilities of free and of occupied at each level, (2, LEVELS).

    Args:
        counts: how many cells of each level were truly free, occupied, and neither, (LEVELS, 3).
    """
    # One more of each, after Laplace: nothing is certain, and a level never met is no gap.
    cells = counts + 1.0
    weights = cells.sum(axis=1)
    share = cells / weights[:, None]
    free = isotonic_regression(share[:, 0], weights=weights).x
    occupied = isotonic_regression(share[:, 1], weights=weights, increasing=False).x
    return np.stack([free, occupied])


def counted(
    grey: NDArray[np.floating], truth: NDArray[np.uint8], unseen: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Cells not seen by level of grey and by what they truly are, (LEVELS, 3).

    Args:
        grey: in [-1, 1], any shape.
        truth: 0 free, 1 occupied, 2 neither; the same shape.
        unseen: which cells count.
    """
    both = 3 * level_of(grey[unseen]) + truth[unseen]
    return np.bincount(both, minlength=3 * LEVELS).reshape(LEVELS, 3).astype(np.int64)
