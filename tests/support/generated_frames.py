"""Frames of crossings, without driving: the attributes of `predictor.data.frames.Frames`."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from predictor.data.squares import Square


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

    def square(self, index: int, expansion: float) -> Square:
        return Square.of(
            self.estimated[index], self.remembered[index], self.truth(index, expansion)
        )

    @property
    def worlds(self) -> frozenset[str]:
        return frozenset(str(facts["world"]) for facts in self.about)

    @property
    def digest(self):
        return hashlib.sha256(self.estimated.tobytes()).hexdigest()


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


def write_frames(folder: Path, splits: dict[str, GeneratedFrames], kind: str = "simulated") -> None:
    """Write sets of frames as `predictor.data.frames` reads them, a split a trajectory.

    In a physical set a split is a site.
    """
    from predictor.data.frame_set import FrameSet, write_trajectory

    made = FrameSet(folder, kind, {}, list(splits))
    for split, frames in splits.items():
        count = len(frames)
        arrays = {
            "estimated": frames.estimated,
            "remembered": frames.remembered,
            "states": np.zeros((count, 4)),
            "actions": np.zeros((count, 2)),
            "times": np.arange(count, dtype=np.float64),
            "map": np.concatenate(list(frames.whole)),
            "origin": np.zeros(2),
            "corners": np.array([[200 * i, 0] for i in range(count)], dtype=np.int32),
        }
        of = split if kind == "simulated" else kind
        about = {"split": of, "map": split, "world": frames.about[0]["world"]}
        made.add(split, write_trajectory(folder, split, arrays, about))
