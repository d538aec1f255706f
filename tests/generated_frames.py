"""Frames out of generated buildings, without driving: the attributes of `predictor.frames.Frames`."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation


@dataclass(eq=False)
class GeneratedFrames:
    """See `generated`."""

    about: list[dict[str, Any]]
    trajectory: NDArray[np.intp]
    estimated: NDArray[np.uint8]
    remembered: NDArray[np.uint8]
    whole: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.trajectory)

    def truth(self, index: Any, expansion: float) -> NDArray[np.uint8]:
        inset = (200 - round(100 * expansion)) // 2
        return self.whole[index, inset : 200 - inset, inset : 200 - inset]

    @property
    def worlds(self) -> frozenset[str]:
        return frozenset(str(facts["world"]) for facts in self.about)


def generated(count: int, seed: int) -> GeneratedFrames:
    """Crossings of two corridors, seen from near their middle.

    Args:
        count: of frames.
        seed: of the buildings; another one, other buildings.
    """
    rng = np.random.default_rng(seed)
    whole = np.full((count, 200, 200), 2, np.uint8)
    seen = np.full((count, 200, 200), 2, np.uint8)
    for truth, known in zip(whole, seen, strict=True):
        free = np.zeros((200, 200), dtype=bool)
        for axis in (0, 1):
            middle, half = 100 + int(rng.integers(-15, 16)), int(rng.integers(15, 35))
            np.moveaxis(free, axis, 0)[middle - half : middle + half] = True
        truth[free] = 0
        truth[binary_dilation(free) & ~free] = 1
        reach = 50 + int(rng.integers(0, 20))
        known[100 - reach : 100 + reach, 50:150] = truth[100 - reach : 100 + reach, 50:150]
    about = [{"world": f"{seed:032x}", "seed": seed, "split": "train", "count": count}]
    estimated = np.ascontiguousarray(seen[:, 50:150, 50:150])
    return GeneratedFrames(about, np.zeros(count, np.intp), estimated, seen, whole)
