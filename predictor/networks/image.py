"""Maps as grey images: free is white, +1; unobserved is grey, 0; occupied is black, -1.

Input and target of a network are images of the same square, so that an observed cell is at the
same place in both, and the skip connections of a U-Net can copy it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor.data.squares import GREYS


def image_of(codes: NDArray[np.uint8], side: int) -> NDArray[np.int8]:
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
    first = np.searchsorted(pixels_of(n, side), np.arange(side))
    rows = np.minimum.reduceat(GREYS[codes], first, axis=-2)
    # Black, grey, white: the smallest grey wins.
    return np.minimum.reduceat(rows, first, axis=-1)


def pixels_of(n: int, side: int) -> NDArray[np.intp]:
    """Return the row of pixels, of `side`, that holds the middle of each of n rows of cells."""
    return ((np.arange(n) + 0.5) * (side / n)).astype(np.intp)


def pixels_at_cells(image: NDArray[Any], n: int) -> NDArray[Any]:
    """Return the pixel at each cell's middle: from images (..., side, side) back to (..., n, n)."""
    pixels = pixels_of(n, image.shape[-1])
    return image[..., pixels[:, None], pixels]
