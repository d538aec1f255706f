"""Writing of frames as a video: a GIF, or an MP4 if there is ffmpeg."""

from __future__ import annotations

import contextlib
import itertools
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from foresee.infra.atomic_file import replacing
from foresee.infra.errors import LineError
from foresee.infra.progress import progress

Picture = NDArray[np.uint8]
"""Pixels of a frame, (height, width, 3)."""
Pictures = Iterator[Picture]
LAST = 2000
"""Time for which a GIF shows its last frame [ms]."""


class VideoError(LineError):
    """A video cannot be written; the message is one line."""


def kind_for(wanted: str) -> str:
    """Return the file type, "gif" or "mp4"; for "auto", "mp4" if there is ffmpeg.

    Raises:
        VideoError: if MP4 is wanted and there is no ffmpeg.
    """
    if wanted == "gif":
        return wanted
    try:
        _ffmpeg()
    except VideoError:
        if wanted == "mp4":
            raise
        return "gif"
    return "mp4"


def write_video(frames: Callable[[int], Picture], count: int, rate: float, path: Path) -> None:
    """Write a video atomically, with a progress bar.

    Args:
        frames: function from the number of a frame to its pixels.
        count: number of frames.
        rate: frame rate [1/s].
        path: path of the file; its ending, .gif or .mp4, decides the format.

    Raises:
        VideoError: if there are no frames, or ffmpeg fails.
    """
    if count == 0:
        raise VideoError(f"{path.name}: the drive has no ticks to show")
    with (
        replacing(path) as part,
        progress(range(count), desc=path.name, unit="frame") as numbers,
    ):
        pictures = (frames(i) for i in numbers)
        if path.suffix == ".mp4":
            _write_mp4(pictures, rate, part)
        else:
            samples = np.vstack([frames(i) for i in sorted({0, count // 2, count - 1})])
            _write_gif(pictures, samples, [round(1000 / rate)] * (count - 1) + [LAST], part)


def _write_gif(frames: Pictures, samples: Picture, durations: list[int], path: Path) -> None:
    # One palette for all frames, so that only the changes between frames must be stored.
    palette = Image.fromarray(samples).quantize(255, Image.Quantize.FASTOCTREE)
    pictures = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    first, shown = next(pictures), {"duration": durations, "loop": 0, "optimize": False}
    first.save(path, format="GIF", save_all=True, append_images=pictures, **shown)


def _ffmpeg() -> str:
    """Return the path of ffmpeg: that of the system, or of the package imageio-ffmpeg."""
    if (path := shutil.which("ffmpeg")) is not None:
        return path
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        line = "an MP4 needs ffmpeg: pip install 'foresee-nav[video]'; a GIF does not"
        raise VideoError(line) from None
    return str(get_ffmpeg_exe())


def _write_mp4(frames: Pictures, rate: float, path: Path) -> None:
    first = next(frames)
    # The pixel format yuv420p needs even sides.
    height, width = (side - side % 2 for side in first.shape[:2])
    command = (
        f"-y -loglevel error -f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {rate:g} "
        "-i - -pix_fmt yuv420p -movflags +faststart -f mp4"
    )
    with subprocess.Popen(
        [_ffmpeg(), *command.split(), str(path)], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdin is not None
        try:
            # If ffmpeg ends early, its own message is reported below.
            with contextlib.suppress(BrokenPipeError):
                for frame in itertools.chain([first], frames):
                    process.stdin.write(frame[:height, :width].tobytes())
            message = process.communicate()[1].decode(errors="replace").strip()
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:
        raise VideoError(f"ffmpeg failed: {(message or 'no reason given').splitlines()[-1]}")
