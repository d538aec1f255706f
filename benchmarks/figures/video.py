"""Writing of frames as a video: an animated GIF."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from foresee.infra.command_line import UsageError

LAST = 2000
"""Time for which the last frame is shown [ms]."""


def write_gif(
    frames: Callable[[int], NDArray[np.uint8]], count: int, rate: float, path: Path
) -> None:
    """Write a GIF atomically, with a progress bar.

    Args:
        frames: function from the number of a frame to its pixels, (height, width, 3).
        count: number of frames.
        rate: frame rate [1/s].
        path: path of the file.

    Raises:
        UsageError: if there are no frames.
    """
    if count == 0:
        raise UsageError(f"{path.name}: the drive has no ticks to show")
    part = path.with_name(f".{os.getpid()}.{path.name}")
    # One palette for all frames, so that only the changes between frames must be stored.
    samples = np.vstack([frames(i) for i in sorted({0, count // 2, count - 1})])
    palette = Image.fromarray(samples).quantize(255, dither=Image.Dither.NONE)
    try:
        with tqdm(range(count), desc=path.name, unit="frame") as numbers:
            pictures = (
                Image.fromarray(frames(i)).quantize(palette=palette, dither=Image.Dither.NONE)
                for i in numbers
            )
            first, durations = next(pictures), [round(1000 / rate)] * (count - 1) + [LAST]
            shown = {"duration": durations, "loop": 0, "optimize": False}
            first.save(part, format="GIF", save_all=True, append_images=pictures, **shown)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
