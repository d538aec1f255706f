"""Input and target images of the paper's networks, from squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from predictor.data.squares import Square
from predictor.networks.image import image_of
from predictor.networks.image_config import ImageConfig


def images_of(
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
    return image_of(given[:, None], config.side), image_of(wanted[:, None], config.side)
