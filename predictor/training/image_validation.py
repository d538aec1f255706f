"""Images, validation and calibration of the greys of the paper's networks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from predictor.data.frames import Frames
from predictor.data.samples import Samples
from predictor.data.squares import GREYS, NOTHING, Square
from predictor.networks.grey_image import (
    GREY_LEVELS,
    counted,
    fitted,
    grey_level,
    map_images,
    pixels_at_cells,
)
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.scoring.images import ssim
from predictor.scoring.scores import RINGS, Scores
from predictor.training.trainer import spread

VALIDATED, FITTED = 64, 1024
"""Number of frames of a validation, and of the calibration at the end, spread evenly over the
drives."""
AT_ONCE = 16
"""Number of frames per call of the network."""


def images_alike(net: GreyNet, frames: Frames | Samples) -> dict[str, float]:
    """Compute the mean absolute difference and the SSIM of a network's images and the true ones.

    Args:
        net: the network.
        frames: set of which VALIDATED frames are taken.
    """
    chosen = spread(len(frames), VALIDATED).tolist()
    squares = [frames.square(i, net.config.expansion) for i in chosen]
    greys = predict_greys(net, squares)
    truths = GREYS[np.stack([square.truth for square in squares])].astype(np.float32)
    alike = [ssim(grey, truth, span=2.0) for truth, grey in zip(truths, greys, strict=True)]
    return {"validation_l1": float(abs(greys - truths).mean()), "ssim": float(np.mean(alike))}


def fit(net: GreyNet, frames: Frames | Samples) -> dict[str, float]:
    """Calibrate a network's greys on unobserved cells: fit its `chances`, in place.

    Args:
        net: network.
        frames: set of which FITTED frames are taken.

    Returns:
        Scores on the same cells. They show how sharp the probabilities are; their calibration
        must be measured on other cells.
    """
    parts = []
    counts = np.zeros((GREY_LEVELS, 3), dtype=np.int64)
    every = spread(len(frames), FITTED).tolist()
    for first in range(0, len(every), VALIDATED):
        chosen = every[first : first + VALIDATED]
        squares = [frames.square(i, net.config.expansion) for i in chosen]
        greys = predict_greys(net, squares)
        truth = np.stack([square.truth for square in squares])
        unseen = np.stack([square.window == NOTHING for square in squares])
        counts += counted(greys, truth, unseen)
        parts.append((grey_level(greys[unseen]).astype(np.int16), truth[unseen]))
    chances = fitted(counts).astype(np.float32)
    net.chances.copy_(torch.from_numpy(chances))
    scores = Scores()
    for levels, truth in parts:
        anywhere = np.full(levels.shape, RINGS - 1, dtype=np.int8)
        scores.add(chances[0, levels], chances[1, levels], truth == 0, truth == 1, anywhere)
    return scores.measures()


def predict_greys(net: GreyNet, squares: list[Square]) -> NDArray[np.float32]:
    """Return the greys of a network for some squares, one for each cell, (B, n, n) in [-1, 1]."""
    n = len(squares[0].truth)
    out = np.empty((len(squares), n, n), dtype=np.float32)
    device = next(net.parameters()).device
    net.eval()
    for first in range(0, len(squares), AT_ONCE):
        given, _ = batch_images(squares[first : first + AT_ONCE], net.config)
        with torch.inference_mode():
            images = net(torch.from_numpy(given).to(device).float())
        out[first : first + AT_ONCE] = pixels_at_cells(images[:, 0].float().cpu().numpy(), n)
    return out


def batch_images(
    squares: Sequence[Square], config: ImageConfig
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return the input and the target images of a network of the paper.

    Args:
        squares: squares of the network's expansion.
        config: settings of the network.

    Returns:
        Input and target images, (B, 1, side, side) each.
    """
    given = np.stack(
        [square.crop if config.given == "crop" else square.window for square in squares]
    )
    wanted = np.stack([square.truth for square in squares])
    return map_images(given[:, None], config.side), map_images(wanted[:, None], config.side)
