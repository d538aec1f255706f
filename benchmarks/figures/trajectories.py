"""Figure trajectories.png: the trajectories of all arms on the true map, coloured by speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchmarks.figures.palette import (
    CRASH_COLOUR,
    MARKS,
    arm_colour,
    draw_image,
    draw_speed,
    map_image,
    note,
    scale_bar,
)
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import Drive
from foresee.infra.drawing import INK, bare, new_figure, short_name
from foresee.mapping.grid import Grid

MARGIN = 2.5
"""Margin of the shown map around the drives [m]."""
END_MARKS = {"reached": "", "collided": "collision"}
"""Outcome → marker at the end of a drive; "stuck or timed out" for all other outcomes."""


def trajectories(run: Run, indices: Sequence[int] | None = None) -> Figure:
    """Draw the true map and the trajectories, with a row for each episode, a column for each arm.

    Args:
        run: run that contains the drives.
        indices: numbers of the episodes; None: the first three that have been driven.

    Raises:
        RunError: if there is no such episode, or a trace is broken.
    """
    indices = run.indices[:3] if indices is None else list(indices)
    rows = [
        [Drive(run.drives[i, arm], run.trace(i, arm)) for arm in run.driven_arms(i)]
        for i in indices
    ]
    boxes = [_box(row) for row in rows]
    columns = max(len(row) for row in rows)
    width = min(4.2, 15.0 / columns)
    heights = [min(1.3 * width, width * (box[3] - box[2]) / (box[1] - box[0])) for box in boxes]
    figure = new_figure(width * columns + 0.9, sum(heights) + 0.8 * len(rows) + 0.5, maps=True)
    axes = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    for index, row, box, across in zip(indices, rows, boxes, axes, strict=True):
        truth = row[0].trace.truth
        for ax in across[len(row) :]:
            ax.set_visible(False)
        for ax, drive in zip(across, row, strict=False):
            line = _drive(ax, truth, drive, run.setting("v_max"))
            ax.axis(box)
        scale_bar(across[0])
        # The layout reserves room for the height of the name, but not for its length, so that a
        # long name may extend over the next panel.
        name = f"episode {index} · {short_name(row[0].result.world)}"
        for text, counts in ((" ", True), (name, False)):
            title = note(across[0], text, (0, 1), (0, 34), xycoords="axes fraction", fontsize=9)
            title.set_in_layout(counts)
    bar = figure.colorbar(line, ax=axes, shrink=min(1.0, 3.2 / sum(heights)), aspect=22, pad=0.012)
    bar.set_label("speed [m/s]")
    bar.outline.set_visible(False)
    figure.legend(
        handles=_marks([drive for row in rows for drive in row]),
        loc="outside lower center",
        ncols=4,
        fontsize=9,
        handletextpad=0.2,
    )
    return figure


def _marks(drives: list[Drive]) -> list[Line2D]:
    """Return the entries of the legend for the markers that occur."""
    seen = {"start", "goal"} | {_end_mark(drive.result) for drive in drives}
    if any(len(drive.trace.cusps) for drive in drives):
        seen.add("change of gear")
    return [Line2D([], [], label=name, **MARKS[name]) for name in MARKS if name in seen]


def _end_mark(episode: DriveResult) -> str:
    return END_MARKS.get(episode.outcome, "stuck or timed out")


def _box(row: list[Drive]) -> NDArray[np.float64]:
    """Return left, right, bottom and top of the map that an episode's panels show [m]."""
    points = np.vstack([row[0].result.goal] + [drive.trace.states[:, :2] for drive in row])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    # The shorter side is at least 0.4 of the longer one, also for a straight drive.
    short = np.maximum(0.0, 0.4 * (high - low).max() - (high - low)) / 2
    return np.stack([low - short, high + short], axis=1).ravel()


def _drive(ax: Axes, truth: Grid, drive: Drive, v_max: float) -> LineCollection:
    """Draw the panel of one drive, and return the line that is coloured by speed."""
    draw_image(ax, map_image(truth.cells), truth.frame)
    (episode, trace), states = drive, drive.trace.states
    line = draw_speed(ax, states[:, :2], states[:, 3], v_max, width=2.2)
    ax.plot(*states[trace.cusps, :2].T, **MARKS["change of gear"])
    ax.plot(*states[0, :2], **MARKS["start"])
    ax.plot(*episode.goal, **MARKS["goal"])
    if mark := _end_mark(episode):
        ax.plot(*states[-1, :2], **MARKS[mark])
    bare(ax)
    # Arm and outcome are one above the other, since narrow panels have no room for both.
    colour = arm_colour(episode.arm)
    ax.set_title(episode.arm, loc="left", fontsize=10, color=colour, fontweight="bold", pad=17)
    word = episode.outcome.replace("_", " ")
    if episode.outcome == "collided" and episode.impact_speed is not None:
        word += f" at {episode.impact_speed:.1f} m/s"
    style = {"color": INK if episode.outcome == "reached" else CRASH_COLOUR, "fontsize": 9}
    note(ax, f"{word} · {episode.verdict}", (0, 1), (0, 4), xycoords="axes fraction", **style)
    return line
