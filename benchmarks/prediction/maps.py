"""The maps of a data set with the drives through them, as in the paper's figures 2 and 4b."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchmarks.figures.palette import INK, bare, new_figure, scale_bar, shrink
from predictor.data.frames import RESOLUTION, Frames
from predictor.data.squares import TERNARY, cells_of, codes_of

STYLES: dict[str, dict[str, Any]] = {
    "train": {"color": "#D00000", "linestyle": "-"},
    "test": {"color": "black", "linestyle": (0, (1, 1.2))},
    "physical": {"color": "#D00000", "linestyle": "-"},
}
"""Line styles of drives by split, as in the paper."""
LARGEST = 1200
"""Largest side of a map's image [pixels]."""
MARGIN = 2.0
"""Margin around the known part of a map [m]."""
ACROSS = 3
"""Number of maps beside each other."""


def drawn_maps(frames: Frames) -> Figure:
    """Draw all maps with training or test drives, or of a log; white is free, black occupied.

    Args:
        frames: frames of a whole set.
    """
    drives: dict[str, list[int]] = {}
    for number, about in enumerate(frames.about):
        if about["split"] in STYLES:
            drives.setdefault(str(about["map"]), []).append(number)
    columns = min(ACROSS, len(drives))
    rows = math.ceil(len(drives) / columns)
    figure = new_figure(3.6 * columns, 3.4 * rows + 0.3, maps=True)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat[len(drives) :]:
        axis.set_axis_off()
    for axis, (name, numbers) in zip(axes.flat, drives.items(), strict=False):
        _draw_map(axis, frames.maps[numbers[0]], frames.origins[numbers[0]])
        for number in numbers:
            style = STYLES[frames.about[number]["split"]]
            states = frames.states[frames.trajectory == number]
            axis.plot(*states[:, :2].T, linewidth=1.6, **style)
            axis.plot(*states[0, :2], "o", color=style["color"], markersize=4)
        axis.set_title(name, fontsize=9, color=INK)
        bare(axis)
        scale_bar(axis, 10.0)
    splits = dict.fromkeys(about["split"] for about in frames.about if about["split"] in STYLES)
    if len(splits) > 1:
        lines = [Line2D([], [], linewidth=1.6, label=split, **STYLES[split]) for split in splits]
        figure.legend(
            handles=lines, loc="outside lower center", ncols=len(lines), frameon=False, fontsize=8
        )
    return figure


def _draw_map(axis: Axes, codes: NDArray[np.uint8], origin: NDArray[np.float64]) -> None:
    """Draw the known part of a map in the paper's greys."""
    known = np.argwhere(codes != 2)
    pad = round(MARGIN / RESOLUTION)
    low = np.maximum(known.min(axis=0) - pad, 0)
    high = np.minimum(known.max(axis=0) + 1 + pad, codes.shape)
    factor = math.ceil(max(high - low) / LARGEST)
    part = shrink(cells_of(codes[low[0] : high[0], low[1] : high[1]]), factor)
    grey = TERNARY[codes_of(part)]
    (y, x), step = origin[::-1] + RESOLUTION * low, RESOLUTION * factor
    axis.imshow(
        grey,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        interpolation="nearest",
        extent=(x, x + step * part.shape[1], y, y + step * part.shape[0]),
    )
