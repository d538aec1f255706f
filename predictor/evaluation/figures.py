"""Figures of predictors' scores: reliability diagrams, measures over distance, sheets of images."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.drawing import INK, bare, new_figure, save_figures
from predictor.scoring.scores import EDGES, RINGS, Scores

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PREDICTOR_COLOURS = {
    "unet_ff": "#0072B2",
    "resnet_ff": "#56B4E9",
    "gan": "#CC79A7",
    "mlp": "#B8A000",
    "compact": "#D55E00",
    "extend": "#009E73",
    "copy": "#222222",
    "grey": "#999999",
    "none": "#6B5B4B",
}
"""Predictor → colour; from the same source, darkened where a line would be hard to see on white."""
OTHER_PREDICTORS = ("#E69F00", "#882255", "#44AA99", "#332288")
"""Colours, in turn, of predictors that have none of their own; after P. Tol's `muted` scheme."""
_TURNS = itertools.cycle(OTHER_PREDICTORS)

ENOUGH, SHARE = 1000, 5e-4
"""Smallest number of cells of a ring, and smallest share of the cells in a bin, for a point to be
drawn."""
SHOWN = 5
"""Number of predictions of each kind on the sheet of an evaluation."""
OF_RINGS = {
    "iou_free": "IoU of free",
    "brier_free": "Brier score of free",
    "iou_occupied": "IoU of occupied",
}
"""Measures that an evaluation draws over the distance, with their labels."""

Curve = Sequence[Any]
"""Reliability diagram: mean probability, observed share, and share of the cells of each bin."""


def draw_evaluation(
    out: Path,
    groups: dict[str, dict[str, Scores]],
    pictures: list[tuple[float, NDArray[np.uint8]]],
    predictors: tuple[str, ...],
) -> None:
    """Write reliability.png, rings.png and sheet.png of an evaluation into a folder.

    Args:
        out: folder of the figures.
        groups: group → predictor → scores.
        pictures: error, and images (3, rows, columns) of what was observed, predicted and true.
        predictors: names in the order of the legend.
    """
    if not groups:
        return

    def rings(scores: Scores) -> list[dict[str, float]]:
        return [{"from": EDGES[i], **scores.measures(slice(i, i + 1))} for i in range(RINGS)]

    of_rings = {
        group: {name: rings(scores[name]) for name in predictors}
        for group, scores in groups.items()
    }
    curves = {
        group: {
            f"was {state}": {name: scores[name].reliability(state) for name in predictors}
            for state in ("free", "occupied")
        }
        for group, scores in groups.items()
    }
    figures = [
        ("reliability.png", partial(reliability, curves)),
        ("rings.png", partial(over_distance, of_rings, OF_RINGS)),
    ]
    if pictures:
        figures.append(("sheet.png", partial(_good_and_bad, pictures)))
    save_figures(figures, out)


@cache
def predictor_colour(name: str) -> str:
    """Return the colour of a predictor, the same in every figure of a run."""
    return PREDICTOR_COLOURS[name] if name in PREDICTOR_COLOURS else next(_TURNS)


def reliability(columns: Mapping[str, Mapping[str, Mapping[str, Curve]]]) -> Figure:
    """Draw reliability diagrams: column → row → predictor → curve."""
    rows = next(iter(columns.values()))
    figure, axes = panels(columns, rows, "probability given", maps=True)
    for row, drawn in zip(axes.T, columns.values(), strict=True):
        for axis, curves in zip(row, drawn.values(), strict=True):
            axis.plot([0, 1], [0, 1], color="#999999", linewidth=0.8)
            for name, curve in curves.items():
                bins = np.array(curve, dtype=np.float64)
                given, came_true, share = bins[:, bins[2] >= SHARE]
                colour = predictor_colour(name)
                axis.plot(given, came_true, color=colour, linewidth=1.0, label=name)
                # The area of a bin's dot grows with its share of the cells.
                dots = 2 + 80 * share
                axis.scatter(given, came_true, dots, color=colour, alpha=0.5, linewidths=0)
            axis.set(aspect="equal", xlim=(0, 1), ylim=(0, 1))
            axis.set_xticks([0, 0.5, 1], ["0", "½", "1"])
            axis.set_yticks([0, 0.5, 1], ["0", "½", "1"])
    legend(figure, axes)
    return figure


def over_distance(
    columns: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]], measures: Mapping[str, str]
) -> Figure:
    """Draw measures of unobserved cells over the cells' distance beyond the frontier.

    Args:
        columns: column → predictor → rings, each with `from` [m], `cells` and the measures.
        measures: name of each measure → label.
    """
    figure, axes = panels(columns, measures.values(), "beyond the frontier [m]")
    for row, predictors in zip(axes.T, columns.values(), strict=True):
        for axis, measure in zip(row, measures, strict=True):
            for name, rings in predictors.items():
                first = [ring["from"] for ring in rings]
                middle = np.convolve([*first, 1.5 * first[-1]], [0.5, 0.5], "valid")
                values = [ring[measure] if ring["cells"] >= ENOUGH else None for ring in rings]
                line(axis, middle, values, name)
            axis.set_ylim(bottom=0.0)
    legend(figure, axes)
    return figure


def line(axis: Axes, x: Sequence[float] | NDArray[Any], values: Sequence[Any], name: str) -> None:
    """Draw a predictor's values; None leaves a gap."""
    axis.plot(
        x,
        np.array(values, dtype=np.float64),
        color=predictor_colour(name),
        marker="o",
        markersize=3,
        linewidth=1.1,
        label=name,
    )
    axis.grid(alpha=0.3)


def panels(
    columns: Iterable[str], rows: Iterable[str], below: str, maps: bool = False
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with a grid of panels, and its axes (rows, columns).

    Args:
        columns: titles of the columns.
        rows: labels of the rows.
        below: label of the x axes.
        maps: see `new_figure`.
    """
    columns, rows = list(columns), list(rows)
    width, height = (1.8, 1.8) if maps else (2.5, 2.2)
    figure = new_figure(width * len(columns) + 1.8, height * len(rows) + 0.5, maps)
    axes = figure.subplots(len(rows), len(columns), squeeze=False, sharex=True, sharey="row")
    for axis, title in zip(axes[0], columns, strict=True):
        axis.set_title(title, fontsize=9)
    for axis, label in zip(axes[:, 0], rows, strict=True):
        axis.set_ylabel(label, fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel(below)
    return figure, axes


def legend(figure: Figure, axes: NDArray[Any]) -> None:
    """Draw one legend for all panels beside them."""
    entries: dict[str, Any] = {}
    for axis in axes.flat:
        handles, labels = axis.get_legend_handles_labels()
        entries = dict(zip(labels, handles, strict=True)) | entries
    figure.legend(entries.values(), entries, loc="outside right center", frameon=False, fontsize=8)


def sheet(
    rows: Sequence[Mapping[str, NDArray[np.uint8]]], columns: Sequence[str]
) -> tuple[Figure, NDArray[Any]]:
    """Draw images in a grid, and return the figure and its axes (rows, columns).

    Args:
        rows: column → grey image (n, n), for each row; a missing image leaves a gap.
        columns: columns in their order.
    """
    figure = new_figure(1.35 * len(columns) + 0.4, 1.45 * len(rows) + 0.5, maps=True)
    axes = figure.subplots(len(rows), len(columns), squeeze=False)
    for axis, column in zip(axes[0], columns, strict=True):
        axis.set_title(column, fontsize=8, color=INK)
    for images, row in zip(rows, axes, strict=True):
        for axis, column in zip(row, columns, strict=True):
            if column in images:
                n = len(images[column])
                grey = {"cmap": "gray", "vmin": 0, "vmax": 255, "interpolation": "nearest"}
                axis.imshow(images[column], origin="lower", extent=(0, n, 0, n), **grey)
                bare(axis)
            else:
                axis.set_axis_off()
    return figure, axes


def caption(axis: Axes, text: str) -> None:
    """Write a line below an image of a sheet."""
    axis.set_xlabel(text, fontsize=6.5, color=INK, labelpad=1.5)


def _good_and_bad(pictures: list[tuple[float, NDArray[np.uint8]]]) -> Figure:
    """Draw the predictions with the least, the middle and the greatest errors."""
    pictures = sorted(pictures, key=lambda entry: entry[0])
    first = max(0, (len(pictures) - SHOWN) // 2)
    blocks = {
        "good": pictures[:SHOWN],
        "typical": pictures[first : first + SHOWN],
        "worst": pictures[-SHOWN:],
    }
    titles = [f"{kind}: {what}" for kind in blocks for what in ("seen", "predicted", "true")]
    rows: list[dict[str, NDArray[np.uint8]]] = [{} for _ in pictures[:SHOWN]]
    for block, shown in enumerate(blocks.values()):
        for row, (_, images) in zip(rows, shown, strict=True):
            row.update(zip(titles[3 * block :], images, strict=False))
    figure, axes = sheet(rows, titles)
    for block, shown in enumerate(blocks.values()):
        for axis, (error, _) in zip(axes[:, 3 * block + 1], shown, strict=True):
            caption(axis, f"Brier {error:.3f}")
    return figure
