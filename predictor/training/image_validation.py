"""How good a network's images are on validation drives, and what their greys mean."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from predictor.networks.grey_map import LEVELS, counted, fitted, level_of
from predictor.networks.image import GREYS, cells_of
from predictor.networks.image_net import ImageNet
from predictor.scoring.scores import RINGS, Scores
from predictor.training.pairs import Pairs

VALIDATED, FITTED = 64, 1024
"""Frames, spread evenly over the drives: to look at now and then, and to fit on in the end."""
AT_ONCE = 16
"""Frames that go through a network together."""


def images_alike(net: ImageNet, pairs: Pairs) -> dict[str, float]:
    """Mean difference and structural similarity of a network's images and the true ones.

    Args:
        net: the network.
        pairs: of which VALIDATED are taken.
    """
    from skimage.metrics import structural_similarity

    chosen = _spread(pairs, VALIDATED)
    greys = greys_of(net, pairs, chosen)
    truths = GREYS[np.stack([pairs.truth(int(i)) for i in chosen])].astype(np.float32)
    alike = [structural_similarity(truth, grey, data_range=2.0)
             for truth, grey in zip(truths, greys, strict=True)]  # fmt: skip
    return {"validation_l1": float(abs(greys - truths).mean()), "ssim": float(np.mean(alike))}


def fit(net: ImageNet, pairs: Pairs) -> dict[str, float]:
    """Fit what a network's greys mean, in place, on cells that had not been seen.

    Args:
        net: the network, whose `chances` are set.
        pairs: of which FITTED are taken.

    Returns:
        Scores on these same cells: they say how sharp the probabilities can be, not how well
        calibrated they are elsewhere.
    """
    parts = []
    counts = np.zeros((LEVELS, 3), dtype=np.int64)
    every = _spread(pairs, FITTED)
    for first in range(0, len(every), VALIDATED):
        chosen = every[first : first + VALIDATED]
        greys = greys_of(net, pairs, chosen)
        truth = np.stack([pairs.truth(int(i)) for i in chosen])
        unseen = np.stack([pairs.known(int(i)) == 2 for i in chosen])
        counts += counted(greys, truth, unseen)
        parts.append((level_of(greys[unseen]).astype(np.int16), truth[unseen]))
    chances = fitted(counts).astype(np.float32)
    net.chances.copy_(torch.from_numpy(chances))
    scores = Scores()
    for levels, truth in parts:
        anywhere = np.full(levels.shape, RINGS - 1, dtype=np.int8)
        scores.add(chances[0, levels], chances[1, levels], truth == 0, truth == 1, anywhere)
    return scores.measures()


def greys_of(net: ImageNet, pairs: Pairs, chosen: NDArray[np.intp]) -> NDArray[np.float32]:
    """What a network prints of some frames, cell by cell: (B, n, n) in [-1, 1]."""
    out = np.empty((len(chosen), pairs.n, pairs.n), dtype=np.float32)
    device = next(net.parameters()).device
    net.eval()
    for first in range(0, len(chosen), AT_ONCE):
        given, _ = pairs.images(chosen[first : first + AT_ONCE])
        with torch.inference_mode():
            images = net(torch.from_numpy(given).to(device).float())
        out[first : first + AT_ONCE] = cells_of(images[:, 0].float().cpu().numpy(), pairs.n)
    return out


def _spread(pairs: Pairs, count: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, len(pairs) - 1, count).astype(np.intp))
