"""How alike two images of maps are: SSIM as a whole, where nothing was seen, and coarser far off.

Images are ternary as in the paper, 1 free, 0.5 unknown, 0 occupied, or greys between; SSIM is that
of Wang et al. 2004 as scikit-image computes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from predictor.data.frames import CROP, RESOLUTION

SETTINGS = {
    "data_range": 1.0,
    "win_size": 7,
    "gaussian_weights": False,
    "use_sample_covariance": True,
    "K1": 0.01,
    "K2": 0.03,
}
"""Of scikit-image, all as by default, written out so that a default may change."""
LEVELS = ((0.0, 2), (1.25, 4))
"""Beyond how far from the 5 m crop [m] how many cells along each axis are averaged into one."""


@dataclass(frozen=True)
class Similarity:
    """SSIM of one image.

    Attributes:
        ssim: scikit-image's mean, which leaves out a rim of three cells.
        ssim_kept: the same, of the image in which what was seen is as it was seen: what a planner
            would get.
        ssim_unseen: mean of its map over cells not seen outside the 5 m crop; NaN if there is none.
        ssim_coarse: mean over all cells of the map of each cell's own resolution, see `LEVELS`.
        ssim_coarse_unseen: the same over the cells of `ssim_unseen`.
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
    """How alike an image and the true one are.

    Args:
        image: greys in [0, 1], (n, n), n even.
        kept: the same, in which what was seen is as it was seen.
        truth: the same, ternary.
        unseen: cells not seen, outside the crop.
    """
    whole, fine = structural_similarity(image, truth, full=True, **SETTINGS)
    coarse = fine.copy()
    beyond = beyond_crop(len(truth))
    for far, block in LEVELS:
        there = beyond > far
        if there.any():
            blocks = (_averaged(one, block) for one in (image, truth))
            _, at_block = structural_similarity(*blocks, full=True, **SETTINGS)
            coarse[there] = _spread(at_block, block, len(truth))[there]
    some = bool(unseen.any())
    same = kept is image
    return Similarity(
        float(whole),
        float(whole if same else structural_similarity(kept, truth, **SETTINGS)),
        float(fine[unseen].mean()) if some else np.nan,
        float(coarse.mean()),
        float(coarse[unseen].mean()) if some else np.nan,
    )


def beyond_crop(n: int) -> NDArray[np.float64]:
    """How far the middle of each cell lies outside the 5 m crop, (n, n) [m]; inside below 0."""
    from_middle = abs(np.arange(n) + 0.5 - n / 2)
    return np.asarray((np.maximum.outer(from_middle, from_middle) - CROP / 2) * RESOLUTION)


def _averaged(image: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Means of blocks of cells; what is missing of the outermost repeats the rim, on all sides."""
    image = np.pad(image, (-len(image) % block) // 2, mode="edge")
    n = len(image) // block
    return np.asarray(image.reshape(n, block, n, block).mean(axis=(1, 3)))


def _spread(values: NDArray[np.float64], block: int, n: int) -> NDArray[np.float64]:
    """Values of blocks, back on n × n cells."""
    first = (len(values) * block - n) // 2
    cells = values.repeat(block, axis=0).repeat(block, axis=1)
    return np.asarray(cells[first : first + n, first : first + n])
