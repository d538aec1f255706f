"""The figures of an evaluation, and its video."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.figures.all_figures import save_figures
from benchmarks.figures.palette import INK, new_figure, predictor_colour
from benchmarks.figures.video import kind_for, write_video
from benchmarks.prediction.maps import drawn_maps
from benchmarks.prediction.pictures import GIVEN, NOTHING, TRUE, Row, Sheets, shown
from benchmarks.prediction.tables import places_of
from predictor.data.frames import CROP, Frames

TITLES = {
    "simulated": "A median square of {leader} on the simulated test drives",
    "physical": "A median square of {leader} on the real drives",
    "random": "Random squares",
    "worst": "The worst squares of {leader}, one a drive",
    "transients": "Random squares of the test drives, with transient obstacles in the input",
}
"""Titles of the sheets; median and worst are by SSIM."""
SIMILAR = {
    "ssim": "SSIM, whole square",
    "ssim_kept": "SSIM, what was seen put back",
    "ssim_unseen": "SSIM, unseen outside the crop",
}
"""Measures drawn over the expansion, with their labels."""
MEASURES = (
    ("iou_free", "IoU of free"),
    ("iou_occupied", "IoU of occupied"),
    ("brier", "Brier"),
    ("ece", "calibration error"),
)
"""Measures drawn over the distance beyond the frontier, with their labels."""
ENOUGH, SHARE = 1000, 5e-4
"""Least number of cells in a ring, and least share of cells in a bin, that are drawn."""
RATE = 10.0
"""Frames per second of the video: every other frame of a drive at 10 Hz, so twice as fast."""
NEAR, FAR = 1.3, 2.0
"""Expansions whose reliability is shown, or the nearest measured."""


def draw(
    out: Path, results: dict[str, Any], sheets: Sheets, sets: Mapping[str, Frames], leader: str
) -> list[Path]:
    """Draw all figures except the video, and return their paths.

    Args:
        out: folder of the figures.
        results: results of `report`.
        sheets: sheets of `pictures`.
        sets: kind → frames, whose maps are drawn.
        leader: predictor whose typical and worst squares are shown.
    """
    places = places_of(results)
    names = {*NOTHING, *shown(_names(next(iter(places.values()))))}
    places = {
        place: {
            x: {name: row for name, row in rows.items() if name in names}
            for x, rows in entry.items()
        }
        for place, entry in places.items()
    }
    figures: list[tuple[str, Callable[[], Figure]]] = [
        ("ssim.png", partial(ssim, places, results["paper"])),
        ("distance.png", partial(by_distance, places)),
        ("reliability.png", partial(reliability, places)),
    ]
    for name in TITLES:
        if name in sheets:
            title = TITLES[name].format(leader=leader)
            figures.append((f"{name}.png", partial(sheet, sheets[name], title)))
    for kind, frames in sets.items():
        figures.append((f"maps-{kind}.png", partial(drawn_maps, frames)))
    return save_figures(figures, out)


def sheet(rows: list[Row], title: str) -> Figure:
    """Draw a sheet with one square in each row: input, predictions, truth."""
    columns = list(dict.fromkeys(name for row in rows for name in row.images if name != "truth"))
    columns.append("truth")
    figure = new_figure(1.35 * len(columns) + 0.4, 1.45 * len(rows) + 0.5, maps=True)
    axes = figure.subplots(len(rows), len(columns), squeeze=False)
    for number, row in enumerate(rows):
        for axis, column in zip(axes[number], columns, strict=True):
            if column in row.images:
                show(axis, row, column)
            else:
                axis.set_axis_off()
            if number == 0:
                axis.set_title(column, fontsize=8, color=INK)
        axes[number, 0].set_ylabel(row.title, fontsize=7, color=INK)
    figure.suptitle(title, fontsize=9, color=INK)
    return figure


def show(axis: Axes, row: Row, column: str) -> None:
    """Draw one image with the outline of the 5 m crop, the car in the input, and SSIM below."""
    image = row.images[column]
    n = len(image)
    axis.imshow(
        image,
        cmap="gray",
        vmin=0,
        vmax=255,
        origin="lower",
        interpolation="nearest",
        extent=(0, n, 0, n),
    )
    edge = (n - CROP) / 2
    axis.plot(
        [edge, n - edge, n - edge, edge, edge],
        [edge, edge, n - edge, n - edge, edge],
        color="#0072B2",
        linewidth=0.7,
        linestyle=(0, (3, 2)),
    )
    if column == GIVEN:
        draw_car(axis, row)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_xlim(0, n)
    axis.set_ylim(0, n)
    for spine in axis.spines.values():
        spine.set_color("#AAAAAA")
    write_ssim(axis, row, column)


def draw_car(axis: Axes, row: Row) -> None:
    """Draw the car as an arrow along its heading."""
    n = len(row.images[GIVEN])
    length = 0.08 * n
    x, y = n / 2 - 0.5 * length * np.cos(row.yaw), n / 2 - 0.5 * length * np.sin(row.yaw)
    axis.arrow(
        x,
        y,
        length * np.cos(row.yaw),
        length * np.sin(row.yaw),
        color="#D55E00",
        width=0.012 * n,
        head_width=0.06 * n,
        length_includes_head=True,
    )


def write_ssim(axis: Axes, row: Row, column: str) -> None:
    """Write SSIM below a prediction."""
    if column in row.ssim:
        axis.set_xlabel(f"{row.ssim[column]:.3f}", fontsize=6.5, color=INK, labelpad=1.5)


def ssim(places: dict[str, Any], paper: dict[str, Any]) -> Figure:
    """Draw SSIM over the expansion, whole and on unobserved cells, with the paper's values."""
    figure = new_figure(2.5 * len(places) + 1.6, 2.4 * len(SIMILAR) + 0.4)
    axes = figure.subplots(len(SIMILAR), len(places), squeeze=False, sharex=True, sharey="row")
    for column, (place, entry) in enumerate(places.items()):
        kind = "simulated" if place == "simulated" else "physical"
        for axis, measure in zip(axes[:, column], SIMILAR, strict=True):
            for name in _names(entry):
                _line(axis, entry, name, measure)
            if measure == "ssim":
                for name in ("unet_ff", "resnet_ff", "gan"):
                    points = [(float(key), row[name]) for key, row in paper[kind].items()]
                    colour = predictor_colour(name)
                    axis.plot(
                        *zip(*points, strict=True),
                        color=colour,
                        linestyle=":",
                        linewidth=1.0,
                        label=f"the paper's {name}",
                    )
                axis.set_title(place, fontsize=9)
            if column == 0:
                axis.set_ylabel(SIMILAR[measure], fontsize=8)
        axes[-1, column].set_xlabel("expansion")
    _legend(figure, axes)
    return figure


def by_distance(places: dict[str, Any]) -> Figure:
    """Draw measures of unobserved cells over the distance beyond the frontier, widest square."""
    figure = new_figure(2.5 * len(places) + 1.6, 2.0 * len(MEASURES) + 0.6)
    axes = figure.subplots(len(MEASURES), len(places), squeeze=False, sharex=True, sharey="row")
    for column, (place, entry) in enumerate(places.items()):
        expansion, rows = list(entry.items())[-1]
        for axis, (measure, label) in zip(axes[:, column], MEASURES, strict=True):
            for name, row in rows.items():
                rings = row["rings"]
                ends = [ring["from"] for ring in rings[1:]] + [1.5 * rings[-1]["from"]]
                middle = [0.5 * (ring["from"] + end) for ring, end in zip(rings, ends, strict=True)]
                values = [ring[measure] if ring["cells"] >= ENOUGH else np.nan for ring in rings]
                axis.plot(
                    middle,
                    values,
                    color=predictor_colour(name),
                    marker="o",
                    markersize=2.5,
                    linewidth=1.0,
                    label=name,
                )
            axis.set_ylim(bottom=0.0)
            axis.grid(alpha=0.3)
            if column == 0:
                axis.set_ylabel(label)
        axes[0, column].set_title(f"{place}, {expansion}×", fontsize=9)
        axes[-1, column].set_xlabel("beyond the frontier [m]")
    _legend(figure, axes)
    return figure


def reliability(places: dict[str, Any]) -> Figure:
    """Draw reliability diagrams of free and of occupied."""
    entry = next(iter(places.values()))
    expansions = sorted({_nearest(list(entry), wanted) for wanted in (NEAR, FAR)})
    shown = [(expansion, name) for expansion in expansions for name in ("free", "occupied")]
    figure = new_figure(1.75 * len(places) + 1.9, 1.8 * len(shown) + 0.4, maps=True)
    axes = figure.subplots(len(shown), len(places), squeeze=False, sharex=True, sharey=True)
    for column, (place, measured) in enumerate(places.items()):
        for axis, (expansion, name) in zip(axes[:, column], shown, strict=True):
            axis.plot([0, 1], [0, 1], color="#999999", linewidth=0.8)
            for predictor, row in measured[expansion].items():
                curve = {
                    key: np.array(values, dtype=np.float64)
                    for key, values in row["reliability"][name].items()
                }
                given, came_true, share = (
                    curve[key][curve["share"] >= SHARE] for key in ("given", "came_true", "share")
                )
                colour = predictor_colour(predictor)
                axis.plot(given, came_true, color=colour, linewidth=1.0, label=predictor)
                # The area of a bin's dot grows with its share of the cells.
                axis.scatter(
                    given, came_true, 2 + 80 * share, color=colour, alpha=0.5, linewidths=0
                )
            axis.set_aspect("equal")
            axis.set_xlim(0, 1)
            axis.set_ylim(0, 1)
            axis.set_xticks([0, 0.5, 1], ["0", "½", "1"])
            axis.set_yticks([0, 0.5, 1], ["0", "½", "1"])
            if column == 0:
                axis.set_ylabel(f"was {name}, {expansion}×", fontsize=8)
        axes[0, column].set_title(place, fontsize=9)
        axes[-1, column].set_xlabel("probability given")
    _legend(figure, axes)
    return figure


def write_hallway(rows: list[Row], out: Path) -> Path:
    """Write the paper's video, hallway.mp4, or .gif without ffmpeg, and return its path.

    It shows predictions frame by frame along the straightest stretch of a test drive.

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


def _nearest(expansions: list[str], wanted: float) -> str:
    return min(expansions, key=lambda expansion: abs(float(expansion) - wanted))


def _names(entry: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(name for rows in entry.values() for name in rows))


def _line(axis: Axes, entry: dict[str, Any], name: str, measure: str) -> None:
    points = [(float(key), rows[name][measure]) for key, rows in entry.items() if name in rows]
    x = [at for at, _ in points]
    values = [np.nan if value is None else value for _, value in points]
    axis.plot(
        x, values, color=predictor_colour(name), marker="o", markersize=3, linewidth=1.2, label=name
    )
    axis.grid(alpha=0.3)


def _legend(figure: Figure, axes: Any) -> None:
    found: dict[str, Any] = {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(
        list(found.values()), list(found), loc="outside right center", frameon=False, fontsize=8
    )
