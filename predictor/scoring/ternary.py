"""The paper's image of a map: free white, occupied black, not known grey."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.restoration import denoise_tv_chambolle

from predictor.data.squares import TERNARY, codes_of
from predictor.mapping.grid import Grid
from predictor.prediction import Prediction

PERIMETER = 1.0
"""What an edge of a cell's length costs, in cells that are wrongly free or wrongly not."""
ITERATIONS = 20
"""Of the denoising, which goes towards that space; specks go first."""


def ternary(known: Grid, belief: Prediction | None) -> NDArray[np.float64]:
    """A map, and what is believed of the rest, as one ternary image (rows, columns).

    Of cells not seen those are free that are more likely free than not, but for specks: what is
    looked for is the free space with the least expected number of wrong cells plus PERIMETER times
    its perimeter. A total-variation denoising of p_free, cut at ½, goes towards it (Chan, Esedoglu
    and Nikolova 2006; Chambolle 2004). An edge that nothing speaks for costs SSIM on both of its
    sides; and of a cell for which each probability is below ½, grey is the median, which the L1
    loss makes the paper's networks print. What is certainly not free is never made so.

    Args:
        known: what was seen; it stays as it is.
        belief: of the same cells, with no NaN; None: nothing is believed.
    """
    image = TERNARY[codes_of(known.cells)]
    if belief is None:
        return image
    p_free = np.where(known.unknown, belief.p_free, known.free).astype(np.float64)
    free = (
        denoise_tv_chambolle(p_free, 0.5 * PERIMETER, eps=0.0, max_num_iter=ITERATIONS) > 0.5
    ) & (belief.p_free > 0.0)
    believed = np.where(belief.p_occupied > 0.5, 0.0, np.where(free, 1.0, 0.5))
    return np.where(known.unknown, believed, image)
