"""The paper's video: prediction frame by frame, along the straightest stretch of a test drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.figures.palette import INK
from benchmarks.figures.video import kind_for, write_video
from benchmarks.prediction.figures import draw_car, show, write_ssim
from benchmarks.prediction.pictures import GIVEN, TRUE, Row

RATE = 10.0
"""Frames a second: every other frame of a drive at 10 Hz, so twice as fast as it was."""


def write_hallway(rows: list[Row], out: Path) -> Path:
    """Write hallway.gif, or .mp4 where ffmpeg is there.

    Args:
        rows: frames, in order.
        out: folder.
    """
    path = out / f"hallway.{kind_for('auto')}"
    columns = [GIVEN, *(name for name in rows[0].images if name not in (GIVEN, TRUE)), TRUE]
    figure = Figure(figsize=(1.9 * len(columns), 2.25), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(columns), squeeze=False)[0]
    figure.subplots_adjust(0.01, 0.09, 0.99, 0.88, wspace=0.04)

    for axis, column in zip(axes, columns, strict=True):
        show(axis, rows[0], column)
        axis.set_title(column, fontsize=9, color=INK)

    def frame(number: int) -> NDArray[np.uint8]:
        row = rows[number]
        for axis, column in zip(axes, columns, strict=True):
            axis.images[0].set_data(row.images[column])
            write_ssim(axis, row, column)
        for arrow in axes[0].patches:
            arrow.remove()
        draw_car(axes[0], row)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    write_video(frame, len(rows), RATE, path)
    return path
