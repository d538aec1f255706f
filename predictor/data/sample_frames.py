"""The samples that compact learns from, seen as frames: for comparing it on the same buildings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor.data.samples import SIDE, Samples


@dataclass(frozen=True, eq=False)
class SampleFrames:
    """What `predictor.data.frames.Frames` says of its frames, said of samples.

    They look along +x to within 45°, and were seen through windows of 5 m and more.

    Attributes:
        samples: which.
    """

    samples: Samples

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def about(self) -> list[dict[str, Any]]:
        """Of each drive, what is known of it."""
        return self.samples.about

    @property
    def trajectory(self) -> NDArray[np.intp]:
        """The drive that each is of, (n,)."""
        return self.samples.starts[:, 0].astype(np.intp)

    @property
    def worlds(self) -> frozenset[str]:
        """Hashes of the buildings."""
        return self.samples.worlds

    @property
    def digest(self) -> str:
        """Of all samples, in hexadecimal."""
        return self.samples.digest

    @property
    def estimated(self) -> Squares:
        """The 5 m square of what had been seen, (100, 100) codes each."""
        return Squares(lambda index: _middle(self.samples[index] % 3, 100))

    @property
    def remembered(self) -> Squares:
        """The 10 m square of what had been seen, (200, 200) codes each."""
        return Squares(lambda index: _middle(self.samples[index] % 3, 200))

    def truth(self, index: int, expansion: float) -> NDArray[np.uint8]:
        """The true square that is `expansion` times as wide as 5 m, (side, side) codes."""
        return _middle(self.samples[index] // 3, round(100 * expansion))


@dataclass(frozen=True, eq=False)
class Squares:
    """Images that are made when they are asked for.

    Attributes:
        made: makes one of its number.
    """

    made: Callable[[int], NDArray[np.uint8]]

    def __getitem__(self, index: int) -> NDArray[np.uint8]:
        return self.made(index)


def _middle(codes: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    first = (SIDE - side) // 2
    return codes[first : first + side, first : first + side]
