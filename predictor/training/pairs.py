"""What a network of the paper learns from: frames, as pairs of what is given and what is true."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from predictor.networks.image import image_of

if TYPE_CHECKING:
    from predictor.data.frames import Frames
    from predictor.data.sample_frames import SampleFrames
    from predictor.networks.image_config import ImageConfig


class Pairs:
    """The frames of a split, seen as one network sees them.

    Args:
        frames: the split.
        config: of the network.
    """

    def __init__(self, frames: Frames | SampleFrames, config: ImageConfig) -> None:
        self.frames, self.config = frames, config
        self.n = round(100 * config.expansion)
        """Side of the expanded square [cells]."""

    def __len__(self) -> int:
        return len(self.frames.trajectory)

    def known(self, index: int) -> NDArray[np.uint8]:
        """All that was seen inside the square, which a predictor is handed, (n, n) codes."""
        return _middle(self.frames.remembered[index], self.n)

    def given(self, index: int) -> NDArray[np.uint8]:
        """What the network gets of it, (n, n) codes."""
        if self.config.given == "window":
            return self.known(index)
        return np.pad(self.frames.estimated[index], (self.n - 100) // 2, constant_values=2)

    def truth(self, index: int) -> NDArray[np.uint8]:
        """What is true there, (n, n) codes."""
        return self.frames.truth(index, self.config.expansion)

    def images(self, indices: NDArray[np.intp]) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """Images given and asked for, each (B, 1, side, side)."""
        made = (
            image_of(np.stack([one(int(i)) for i in indices])[:, None], self.config.side)
            for one in (self.given, self.truth)
        )
        given, wanted = made
        return given, wanted


def _middle(codes: NDArray[np.uint8], n: int) -> NDArray[np.uint8]:
    first = (codes.shape[0] - n) // 2
    return codes[first : first + n, first : first + n]
