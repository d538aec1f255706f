"""Frames written as a GIF, or as an MP4 where ffmpeg is at hand."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from predictor.infra.errors import LineError

Frames = Callable[[int], NDArray[np.uint8]]
"""Frame number → its picture, (height, width, 3)."""

LAST = 2000
"""How long a GIF rests on its last frame [ms]."""


class VideoError(LineError):
    """A video cannot be written; the message is one line."""


def kind_for(wanted: str) -> str:
    """Return the file type, "gif" or "mp4"; for "auto" MP4 if ffmpeg is installed.

    Raises:
        VideoError: if MP4 is wanted and there is no ffmpeg.
    """
    ffmpeg = shutil.which("ffmpeg") is not None
    if wanted == "mp4" and not ffmpeg:
        raise VideoError("an MP4 needs ffmpeg on the PATH; a GIF does not")
    if wanted == "auto":
        return "mp4" if ffmpeg else "gif"
    return wanted


def write_video(frames: Frames, count: int, rate: float, path: Path) -> None:
    """Write frames whole or not at all, with a progress bar.

    Args:
        frames: draws one.
        count: how many there are.
        rate: frames a second.
        path: its suffix, .gif or .mp4, says what is written.

    Raises:
        VideoError: if there are no frames, or ffmpeg fails.
    """
    if count == 0:
        raise VideoError(f"{path.name}: the drive has no ticks to show")
    part = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        with tqdm(total=count, desc=path.name, unit="frame") as bar:
            if path.suffix == ".mp4":
                _write_mp4(_counted(frames, count, bar), rate, part)
            else:
                _write_gif(frames, count, rate, part, bar)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _counted(frames: Frames, count: int, bar: tqdm[Any]) -> Iterator[NDArray[np.uint8]]:
    for number in range(count):
        yield frames(number)
        bar.update()


def _write_gif(frames: Frames, count: int, rate: float, path: Path, bar: tqdm[Any]) -> None:
    # One palette for all frames: only what moves must then be stored anew.
    samples = np.vstack([frames(number) for number in sorted({0, count // 2, count - 1})])
    palette = Image.fromarray(samples).quantize(255, dither=Image.Dither.NONE)
    pictures = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in _counted(frames, count, bar)
    )
    durations = [round(1000 / rate)] * (count - 1) + [LAST]
    next(pictures).save(
        path,
        format="GIF",
        save_all=True,
        append_images=pictures,
        duration=durations,
        loop=0,
        optimize=False,
    )


def _write_mp4(frames: Iterator[NDArray[np.uint8]], rate: float, path: Path) -> None:
    first = next(frames)
    # Its coding of colours wants even sides.
    height, width = (side - side % 2 for side in first.shape[:2])
    command = [
        "ffmpeg",
        "-y",
        "-loglevel",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{width}x{height}",
        "-r",
        f"{rate:g}",
        "-i",
        "-",
        "-pix_fmt",
        "yuv420p",
        "-movflags",
        "+faststart",
        "-f",
        "mp4",
        str(path),
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stderr is not None
    try:
        process.stdin.write(first[:height, :width].tobytes())
        for frame in frames:
            process.stdin.write(frame[:height, :width].tobytes())
        process.stdin.close()
    except BrokenPipeError:
        # ffmpeg gave up; its own message follows.
        pass
    message = process.stderr.read().decode(errors="replace").strip()
    if process.wait() != 0:
        raise VideoError(f"ffmpeg failed: {(message or 'no reason given').splitlines()[-1]}")
