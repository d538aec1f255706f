"""Maps as grey images, and the calibration of the greys that a network returns.

Free is white, +1; unobserved is grey, 0; occupied is black, -1. Input and target of a network are
images of the same square, so that an observed cell is at the same place in both, and the skip
connections of a U-Net can copy it.

The calibration gives the probabilities of free and of occupied for each of `GREY_LEVELS`. They are
the shares of cells that are truly free and truly occupied, made monotone by isotonic regression
(Barlow et al. 1972; Zadrozny and Elkan 2002): p_free rises with the grey, p_occupied falls.
Their sum never exceeds 1, since that of the shares does not, and isotonic regression with fixed
weights is monotone in its values.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from predictor.data.squares import GREYS

GREY_LEVELS = 511
"""Number of levels of grey; odd, so that one of them is exactly 0, unknown."""


def map_images(codes: NDArray[np.uint8], side: int) -> NDArray[np.int8]:
    """Return the images (..., side, side) of maps (..., n, n), by nearest neighbour.

    Where several cells make one pixel, occupied wins over unobserved, and that over free: no wall
    is lost, and nothing unobserved becomes free.

    Args:
        codes: 0 free, 1 occupied, 2 unobserved, see `predictor.data.squares`.
        side: side of the image [pixels].
    """
    n = codes.shape[-1]
    if side >= n:
        cells = ((np.arange(side) + 0.5) * (n / side)).astype(np.intp)
        return GREYS[codes[..., cells[:, None], cells]]
    first = np.searchsorted(nearest_pixels(n, side), np.arange(side))
    rows = np.minimum.reduceat(GREYS[codes], first, axis=-2)
    # Black, grey, white: the smallest grey wins.
    return np.minimum.reduceat(rows, first, axis=-1)


def nearest_pixels(n: int, side: int) -> NDArray[np.intp]:
    """Return the row of pixels, of `side`, that holds the middle of each of n rows of cells."""
    return ((np.arange(n) + 0.5) * (side / n)).astype(np.intp)


def pixels_at_cells(image: NDArray[Any], n: int) -> NDArray[Any]:
    """Return the pixel at each cell's middle: from images (..., side, side) back to (..., n, n)."""
    pixels = nearest_pixels(n, image.shape[-1])
    return image[..., pixels[:, None], pixels]


def grey_level(grey: NDArray[np.floating]) -> NDArray[np.intp]:
    """Return the level of each grey in [-1, 1], any shape."""
    return np.rint((grey + 1.0) * (0.5 * (GREY_LEVELS - 1))).astype(np.intp)


def literal() -> NDArray[np.float64]:
    """Return the probabilities before any fit: p_free = grey, p_occupied = -grey.

    Returns:
        p_free and p_occupied at each level, (2, GREY_LEVELS).
    """
    grey = np.linspace(-1.0, 1.0, GREY_LEVELS)
    return np.stack([np.maximum(grey, 0.0), np.maximum(-grey, 0.0)])


def fitted(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Fit the probabilities of free and of occupied at each level, (2, GREY_LEVELS).

    Args:
        counts: number of cells at each level that are truly free, occupied, and neither,
            (GREY_LEVELS, 3).
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
    """Count unobserved cells by level of grey and by true class, (GREY_LEVELS, 3).

    Args:
        grey: greys in [-1, 1], any shape.
        truth: codes 0 free, 1 occupied, 2 neither; the same shape.
        unseen: which cells are unobserved; the same shape.
    """
    both = 3 * grey_level(grey[unseen]) + truth[unseen]
    return np.bincount(both, minlength=3 * GREY_LEVELS).reshape(GREY_LEVELS, 3).astype(np.int64)
