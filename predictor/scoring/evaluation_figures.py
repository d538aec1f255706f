"""Figures of an evaluation: reliability, scores by distance, and good and bad predictions."""

from __future__ import annotations

import io
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from predictor.infra.atomic_file import write_whole
from predictor.scoring.scores import BINS, EDGES, RINGS, Scores

COLOURS = ("#0072B2", "#E69F00", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")
"""Colours of the predictors in their order (Okabe & Ito 2008, for colour-blind readers)."""
SHOWN = 5
"""Pictures of each kind on the sheet."""


def draw(
    out: Path,
    groups: dict[str, dict[str, Scores]],
    pictures: list[tuple[float, NDArray[np.uint8]]],
    predictors: tuple[str, ...],
) -> None:
    """Write reliability.png, rings.png and sheet.png into a folder.

    Args:
        out: folder of the figures.
        groups: group → predictor → scores.
        pictures: error, and images (3, rows, columns) of what was observed, predicted and true.
        predictors: names in the order of the legend.
    """
    if not groups:
        return
    _save(_reliability(groups, predictors), out / "reliability.png")
    _save(_rings(groups, predictors), out / "rings.png")
    if pictures:
        _save(_sheet(sorted(pictures, key=lambda entry: entry[0])), out / "sheet.png")


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=120)
    write_whole(path, buffer.getvalue())


def _panels(groups: dict[str, dict[str, Scores]], rows: int) -> tuple[Figure, NDArray[Any]]:
    figure = Figure(figsize=(3.1 * len(groups) + 0.6, 2.9 * rows + 0.4), layout="constrained")
    return figure, figure.subplots(rows, len(groups), squeeze=False, sharex=True, sharey="row")


def _reliability(groups: dict[str, dict[str, Scores]], predictors: tuple[str, ...]) -> Figure:
    figure, axes = _panels(groups, 2)
    for column, (group, scores) in enumerate(groups.items()):
        for row, name in enumerate(("free", "occupied")):
            axis = axes[row, column]
            axis.plot([0, 1], [0, 1], color="#999999", linewidth=0.8)
            for predictor, colour in zip(predictors, cycle(COLOURS), strict=False):
                p, rate, weight = scores[predictor].reliability(name)
                axis.plot(p, rate, color=colour, linewidth=1.0, label=predictor)
                # The area of a bin's dot grows with its share of the cells.
                axis.scatter(
                    p, rate, 4 + 300 * np.nan_to_num(weight), color=colour, alpha=0.5, linewidths=0
                )
            axis.set_aspect("equal")
            axis.set_xlim(0, 1)
            axis.set_ylim(0, 1)
            if row == 0:
                axis.set_title(group)
            else:
                axis.set_xlabel("probability given")
            if column == 0:
                axis.set_ylabel(f"share that was {name}")
    axes[0, 0].legend(frameon=False, loc="upper left", fontsize=8)
    figure.suptitle(f"Reliability on unobserved cells, {BINS} bins")
    return figure


def _rings(groups: dict[str, dict[str, Scores]], predictors: tuple[str, ...]) -> Figure:
    figure, axes = _panels(groups, 3)
    ends = [*EDGES[1:-1], 1.5 * EDGES[-2]]
    middle = [0.5 * (low + high) for low, high in zip(EDGES, ends, strict=False)]
    rows = (
        ("iou_free", "IoU of free"),
        ("brier_free", "Brier score of free"),
        ("iou_occupied", "IoU of occupied"),
    )
    for column, (group, scores) in enumerate(groups.items()):
        for row, (measure, label) in enumerate(rows):
            axis = axes[row, column]
            for predictor, colour in zip(predictors, cycle(COLOURS), strict=False):
                values = [
                    scores[predictor].measures(slice(i, i + 1))[measure] for i in range(RINGS)
                ]
                axis.plot(middle, values, color=colour, marker="o", markersize=3, label=predictor)
            axis.set_ylim(bottom=0.0)
            axis.grid(alpha=0.3)
            if row == 0:
                axis.set_title(group)
            if row == len(rows) - 1:
                axis.set_xlabel("beyond the frontier [m]")
            if column == 0:
                axis.set_ylabel(label)
    axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def _sheet(pictures: list[tuple[float, NDArray[np.uint8]]]) -> Figure:
    middle = max(0, (len(pictures) - SHOWN) // 2)
    blocks = {
        "good": pictures[:SHOWN],
        "typical": pictures[middle : middle + SHOWN],
        "worst": pictures[-SHOWN:],
    }
    figure = Figure(figsize=(11.5, 1.45 * SHOWN + 0.4), layout="constrained")
    axes = figure.subplots(SHOWN, 9, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for block, (label, shown) in enumerate(blocks.items()):
        for row, (error, images) in enumerate(shown):
            for column, title in enumerate(("seen", "predicted", "true")):
                axis = axes[row, 3 * block + column]
                axis.imshow(images[column], origin="lower", cmap="gray", vmin=0, vmax=255)
                if row == 0:
                    axis.set_title(f"{label}: {title}" if column == 0 else title, fontsize=9)
            axes[row, 3 * block + 1].text(
                0.5,
                -0.02,
                f"Brier {error:.3f}",
                transform=axes[row, 3 * block + 1].transAxes,
                ha="center",
                va="top",
                fontsize=7,
            )
    return figure
