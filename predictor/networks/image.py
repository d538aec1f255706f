"""Maps as grey images: free white, +1; not known grey, 0; occupied black, -1.

What a network is given and what it is asked for are images of the same square, so that what is
known lies where it is asked for again, and the skips of a U-Net carry it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from predictor.data.squares import GREYS


def image_of(codes: NDArray[np.uint8], side: int) -> NDArray[np.int8]:
    """The image (..., side, side) of maps (..., n, n), nearest neighbour.

    Where several cells make one pixel, occupied wins over not known, and that over free: no wall
    is lost, and nothing unknown turns free.

    Args:
        codes: 0 free, 1 occupied, 2 unobserved, see `predictor.data.squares`.
        side: of the image [pixels].
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
    """The row of an image of `side` pixels in which the middle of each of n rows of cells lies."""
    return ((np.arange(n) + 0.5) * (side / n)).astype(np.intp)


def cells_of(image: NDArray, n: int) -> NDArray:
    """The pixel of each cell's middle: images (..., side, side) back to (..., n, n)."""
    pixels = pixels_of(n, image.shape[-1])
    return image[..., pixels[:, None], pixels]
