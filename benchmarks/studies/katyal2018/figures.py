"""The figures of an evaluation."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.figures import palette
from benchmarks.studies.katyal2018.evaluation import Evaluation
from benchmarks.studies.katyal2018.pictures import (
    GIVEN,
    NOTHING,
    TRUE,
    Row,
    pick_leader,
    pictures,
    shown,
)
from benchmarks.studies.katyal2018.tables import drive_kind, predictor_names, split_places
from foresee.infra.drawing import INK, bare, new_figure, save_figures
from foresee.mapping.conventions import CROP_CELLS, RESOLUTION
from foresee.mapping.grid import GridFrame
from predictor.data.frames import Frames
from predictor.data.squares import NOTHING as UNKNOWN
from predictor.data.squares import decode_cells
from predictor.evaluation import figures as scores

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

TITLES = {
    "simulated": "A median square of {leader} on the simulated test drives",
    "physical": "A median square of {leader} on the real drives",
    "worst": "The worst squares of {leader}, one a drive",
}
"""Name of each sheet → title; median and worst are by SSIM."""
SIMILAR = {
    "ssim": "SSIM, whole square",
    "ssim_kept": "SSIM, observed cells restored",
    "ssim_unseen": "SSIM, unobserved, outside the crop",
}
"""Measures that are drawn over the expansion → labels."""
STYLES: dict[str, dict[str, Any]] = {
    "train": {"color": "#D00000", "linestyle": "-"},
    "test": {"color": "black", "linestyle": (0, (1, 1.2))},
    "physical": {"color": "#D00000", "linestyle": "-"},
}
"""Split → line style of its drives on maps, as in the paper."""
OUTLINE: dict[str, Any] = {"color": "#0072B2", "linestyle": (0, (3, 2))}
"""Line style of the 5 m crop on sheets."""
MARGIN = 2.0
"""Margin around the known part of a map [m]."""
ACROSS = 3
"""Number of maps side by side."""


def draw(evaluation: Evaluation, results: dict[str, Any]) -> list[Path]:
    """Draw all figures into the folder of an evaluation, and return their paths.

    Args:
        evaluation: evaluation whose frames are all scored.
        results: results of `report`.
    """
    sheets, leader = pictures(evaluation), pick_leader(evaluation)
    places = split_places(results)
    drawn = {*NOTHING, *shown(predictor_names(next(iter(places.values()))))}
    places = {
        place: {
            x: {name: row for name, row in rows.items() if name in drawn}
            for x, rows in entry.items()
        }
        for place, entry in places.items()
    }
    figures = [("ssim.png", partial(ssim, places, results["paper"]))]
    for name, title in TITLES.items():
        if name in sheets:
            draw_sheet = partial(titled_sheet, sheets[name], title.format(leader=leader))
            figures.append((f"{name}.png", draw_sheet))
    figures += [
        (f"maps-{kind}.png", partial(maps, frames)) for kind, frames in evaluation.sets.items()
    ]
    return save_figures(figures, evaluation.out)


def ssim(places: dict[str, Any], paper: dict[str, Any]) -> Figure:
    """Draw SSIM over the expansion, whole and on unobserved cells, with the paper's values."""
    figure, axes = scores.panels(places, SIMILAR.values(), "expansion")
    for row, (place, entry) in zip(axes.T, places.items(), strict=True):
        for axis, measure in zip(row, SIMILAR, strict=True):
            for name in predictor_names(entry):
                points = {
                    float(x): rows[name][measure] for x, rows in entry.items() if name in rows
                }
                scores.line(axis, list(points), list(points.values()), name)
        published = paper[drive_kind(place)]
        for name in predictor_names(published):
            values = [values[name] for values in published.values()]
            style = {"color": scores.predictor_colour(name), "linestyle": ":", "linewidth": 1.0}
            row[0].plot([*map(float, published)], values, label=f"the paper's {name}", **style)
    scores.legend(figure, axes)
    return figure


def titled_sheet(rows: list[Row], title: str) -> Figure:
    """Draw a sheet with one square in each row: input, predictions, truth.

    Each has the outline of the 5 m crop, the input the car, and predictions their SSIM below.
    """
    names = dict.fromkeys(name for row in rows for name in row.images)
    columns = [*(name for name in names if name != TRUE), TRUE]
    figure, axes = scores.sheet([row.images for row in rows], columns)
    for row, across in zip(rows, axes, strict=True):
        n = len(row.images[GIVEN])
        edge = (n - CROP_CELLS) / 2
        for axis, column in zip(across, columns, strict=True):
            if column in row.images:
                corners = edge + CROP_CELLS * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
                axis.plot(*corners.T, linewidth=0.7, **OUTLINE)
            if column in row.ssim:
                scores.caption(axis, f"{row.ssim[column]:.3f}")
        # The car is an arrow along its heading.
        along = 0.08 * n * np.array([math.cos(row.yaw), math.sin(row.yaw)])
        style = {"color": "#D55E00", "width": 0.012 * n, "head_width": 0.06 * n}
        across[0].arrow(*(n / 2 - along / 2), *along, length_includes_head=True, **style)
        across[0].set_ylabel(row.title, fontsize=7, color=INK)
    figure.suptitle(title, fontsize=9, color=INK)
    return figure


def maps(frames: Frames) -> Figure:
    """Draw all maps with training or test drives, or of a log, as in the paper's figures 2 and 4b.

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
    drawn: dict[str, Line2D] = {}
    for axis, (name, numbers) in zip(axes.flat, drives.items(), strict=False):
        draw_map(axis, frames.maps[numbers[0]], frames.origins[numbers[0]])
        axis.set_title(name, fontsize=9, color=INK)
        bare(axis)
        palette.scale_bar(axis, 10.0)
        for number in numbers:
            split = frames.about[number]["split"]
            x, y = frames.states[frames.trajectory == number, :2].T
            (drawn[split],) = axis.plot(x, y, linewidth=1.6, **STYLES[split])
            axis.plot(x[0], y[0], "o", color=STYLES[split]["color"], markersize=4)
    if len(drawn) > 1:
        look: dict[str, Any] = {"frameon": False, "fontsize": 8, "ncols": len(drawn)}
        figure.legend(drawn.values(), drawn, loc="outside lower center", **look)
    return figure


def draw_map(axis: Axes, codes: NDArray[np.uint8], origin: NDArray[np.float64]) -> None:
    """Draw the known part of a map with a margin around it."""
    known = np.argwhere(codes != UNKNOWN)
    pad = round(MARGIN / RESOLUTION)
    low = np.maximum(known.min(axis=0) - pad, 0)
    high = np.minimum(known.max(axis=0) + 1 + pad, codes.shape)
    cells = decode_cells(codes[low[0] : high[0], low[1] : high[1]])
    x, y = (origin + RESOLUTION * low[::-1]).tolist()
    palette.draw_image(axis, palette.map_image(cells), GridFrame(RESOLUTION, (x, y), cells.shape))
