"""Images of maps as in the paper, and their structural similarity (SSIM).

Images are grey: free 1, unobserved 0.5, occupied 0. SSIM is that of Wang et al. 2004 as
scikit-image computes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity
from skimage.restoration import denoise_tv_chambolle

from foresee.mapping.conventions import CROP_CELLS, RESOLUTION
from foresee.mapping.grid import Grid
from foresee.prediction import Prediction
from predictor.data.squares import TERNARY, encode_cells

PERIMETER = 1.0
"""Cost of an edge of one cell's length, in wrongly drawn cells."""
ITERATIONS = 20
"""Number of iterations of the total-variation denoising."""
SETTINGS = {
    "data_range": 1.0,
    "win_size": 7,
    "gaussian_weights": False,
    "use_sample_covariance": True,
    "K1": 0.01,
    "K2": 0.03,
}
"""Settings of scikit-image's SSIM: its defaults, fixed so that results do not change with them."""
BLOCKS = ((0.0, 2), (1.25, 4))
"""Pairs of a distance from the 5 m crop [m], and the side of the blocks that are averaged beyond it
[cells]."""


def ternary(known: Grid, belief: Prediction | None) -> NDArray[np.float64]:
    """Draw a map and a prediction of the rest as one ternary image (rows, columns).

    Unobserved cells are drawn free if p_free after total-variation denoising is above ½ (Chan,
    Esedoglu and Nikolova 2006; Chambolle 2004). This approximately minimises the expected number of
    wrong cells plus PERIMETER times the perimeter of the free space, which avoids specks: a wrong
    edge lowers SSIM on both of its sides. A cell with both probabilities below ½ is grey: this is
    the median, which the paper's networks return as they are trained with an L1 loss. A cell with
    p_free = 0 is never drawn free.

    Args:
        known: map of all that was observed, which is drawn as it is.
        belief: prediction of the same cells, without NaN; None: unobserved cells are grey.
    """
    image = TERNARY[encode_cells(known.cells)]
    if belief is None:
        return image
    p_free = np.where(known.unknown, belief.p_free, known.free).astype(np.float64)
    free = (
        denoise_tv_chambolle(p_free, 0.5 * PERIMETER, eps=0.0, max_num_iter=ITERATIONS) > 0.5
    ) & (belief.p_free > 0.0)
    believed = np.where(belief.p_occupied > 0.5, 0.0, np.where(free, 1.0, 0.5))
    return np.where(known.unknown, believed, image)


def ssim(image: NDArray[Any], truth: NDArray[Any], span: float = 1.0) -> float:
    """Compute the mean SSIM of an image and the true one, except for a rim of three cells.

    Args:
        image: greys, (n, n).
        truth: true greys, (n, n).
        span: difference of the greys of free and occupied.
    """
    return float(structural_similarity(image, truth, **SETTINGS | {"data_range": span}))


@dataclass(frozen=True)
class Similarity:
    """SSIM of one image in several ways.

    Attributes:
        ssim: mean over the whole square, as `ssim` computes it.
        ssim_kept: the same, for the image in which observed cells keep their observed value, as a
            planner gets it.
        ssim_unseen: mean over unobserved cells outside of the 5 m crop; NaN if there are none.
        ssim_coarse: mean over all cells, at a resolution that falls with the distance, see
            `BLOCKS`.
        ssim_coarse_unseen: the same, over the cells of `ssim_unseen` alone.
    """

    ssim: float
    ssim_kept: float
    ssim_unseen: float
    ssim_coarse: float
    ssim_coarse_unseen: float


def similarity(
    image: NDArray[np.float64],
    kept: NDArray[np.float64],
    truth: NDArray[np.float64],
    unseen: NDArray[np.bool_],
) -> Similarity:
    """Compute the SSIM of an image and the true one in all ways of `Similarity`.

    Args:
        image: greys in [0, 1], (n, n), n even.
        kept: the same image, in which observed cells keep their observed value.
        truth: true image, ternary, (n, n).
        unseen: unobserved cells outside of the crop, (n, n).
    """
    whole, fine = structural_similarity(image, truth, full=True, **SETTINGS)
    coarse = fine.copy()
    beyond = beyond_crop(len(truth))
    for far, block in BLOCKS:
        there = beyond > far
        if there.any():
            blocks = (_averaged(grey, block) for grey in (image, truth))
            _, at_block = structural_similarity(*blocks, full=True, **SETTINGS)
            coarse[there] = _spread(at_block, block, len(truth))[there]
    some = bool(unseen.any())
    same = kept is image
    return Similarity(
        float(whole),
        float(whole if same else ssim(kept, truth)),
        float(fine[unseen].mean()) if some else np.nan,
        float(coarse.mean()),
        float(coarse[unseen].mean()) if some else np.nan,
    )


def beyond_crop(n: int) -> NDArray[np.float64]:
    """Return the distance of each cell's centre from the 5 m crop, (n, n) [m]; negative inside."""
    from_middle = abs(np.arange(n) + 0.5 - n / 2)
    return np.asarray((np.maximum.outer(from_middle, from_middle) - CROP_CELLS / 2) * RESOLUTION)


def _averaged(image: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Return the mean of each block of cells; incomplete blocks repeat the rim."""
    image = np.pad(image, (-len(image) % block) // 2, mode="edge")
    n = len(image) // block
    return np.asarray(image.reshape(n, block, n, block).mean(axis=(1, 3)))


def _spread(values: NDArray[np.float64], block: int, n: int) -> NDArray[np.float64]:
    """Return an image of n × n cells in which each cell has the value of its block."""
    first = (len(values) * block - n) // 2
    cells = values.repeat(block, axis=0).repeat(block, axis=1)
    return np.asarray(cells[first : first + n, first : first + n])
