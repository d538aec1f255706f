"""Where the arms drove, and how fast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchmarks.figures.palette import (
    INK,
    arm_colour,
    bare,
    draw_image,
    map_image,
    new_figure,
    scale_bar,
    speed_line,
)
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import Trace
from predictor.mapping.grid import Grid

MARGIN = 2.5
"""Shown of the building around the drives [m]."""
CUSP_MARK = "D"
START_COLOUR, GOAL_COLOUR, CRASH_COLOUR = "#0072B2", "#009E73", "#C00000"


def trajectories(run: Run, indices: Sequence[int] | None = None) -> Figure:
    """Draw the true map and the paths: a row for each episode, a column for each arm.

    Args:
        run: whose drives.
        indices: which episodes; by default the first three that have been driven.

    Raises:
        RunError: if there is no such episode, or a trace is broken.
    """
    indices = run.indices[:3] if indices is None else list(indices)
    rows = [[(arm, run.trace(index, arm)) for arm in run.arms_of(index)] for index in indices]
    boxes = [_box(run, index, row) for index, row in zip(indices, rows, strict=True)]
    columns = max(len(row) for row in rows)
    width = min(4.2, 15.0 / columns)
    heights = [min(1.3 * width, width * (box[3] - box[2]) / (box[1] - box[0])) for box in boxes]
    figure = new_figure(width * columns + 0.9, sum(heights) + 0.8 * len(rows) + 0.5, maps=True)
    axes = figure.subplots(len(rows), columns, squeeze=False, height_ratios=heights)
    v_max = run.setting("v_max", 4.0)
    line: LineCollection | None = None
    for index, row, box, across in zip(indices, rows, boxes, axes, strict=True):
        truth = run.truth(index)
        for ax in across[len(row) :]:
            ax.set_visible(False)
        for ax, (arm, trace) in zip(across, row, strict=False):
            episode = run.drives[index, arm]
            line = _drive(ax, truth, trace, episode, v_max)
            ax.set_xlim(box[0], box[1])
            ax.set_ylim(box[2], box[3])
            _title(ax, arm, episode)
        scale_bar(across[0], 10.0 if box[1] - box[0] > 25 else 5.0)
        # The layout keeps room for the name's height, not for its length: it may run over the next
        # panel.
        for text, counts in ((" ", True), (f"episode {index} · {_name(run, index)}", False)):
            across[0].annotate(
                text,
                (0, 1),
                (0, 34),
                xycoords="axes fraction",
                textcoords="offset points",
                fontsize=9,
                color=INK,
            ).set_in_layout(counts)
    if line is not None:
        bar = figure.colorbar(
            line, ax=axes, shrink=min(1.0, 3.2 / sum(heights)), aspect=22, pad=0.012
        )
        bar.set_label("speed [m/s]")
        bar.outline.set_visible(False)
    figure.legend(
        handles=_marks(run, indices),
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=9,
        handletextpad=0.2,
    )
    return figure


def _marks(run: Run, indices: Sequence[int]) -> list[Line2D]:
    """Return the legend, with only the marks that occur."""
    seen = {e.outcome for e in run.episodes if e.index in indices}
    marks = [("o", START_COLOUR, 7, "start"), ("*", GOAL_COLOUR, 13, "goal")]
    if any(len(run.trace(i, arm).cusps) for i in indices for arm in run.arms_of(i)):
        marks.append((CUSP_MARK, INK, 5, "change of gear"))
    if "collided" in seen:
        marks.append(("X", CRASH_COLOUR, 11, "collision"))
    if seen & {"stuck", "timed_out"}:
        marks.append(("s", INK, 7, "stuck or timed out"))
    return [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=mark,
            color=colour,
            markersize=size,
            markeredgecolor="white",
            label=label,
        )
        for mark, colour, size, label in marks
    ]


def _name(run: Run, index: int) -> str:
    return run.drives[index, run.arms_of(index)[0]].world


def _box(run: Run, index: int, row: list[tuple[str, Trace]]) -> NDArray[np.float64]:
    """Return left, right, bottom, top of what an episode's panels show [m]."""
    goal = run.drives[index, row[0][0]].goal
    points = np.vstack([np.array([goal])] + [trace.states[:, :2] for _, trace in row])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    # Neither a sliver: a straight drive still gets a panel with some room.
    short = np.maximum(0.0, 0.4 * (high - low).max() - (high - low)) / 2
    low, high = low - short, high + short
    return np.array([low[0], high[0], low[1], high[1]])


def _drive(
    ax: Axes, truth: Grid, trace: Trace, episode: DriveResult, v_max: float
) -> LineCollection:
    draw_image(ax, map_image(truth.cells), truth.frame)
    states = trace.states
    line = speed_line(ax, states[:, :2], states[:, 3], v_max, width=2.2)
    style: dict[str, Any] = {
        "markeredgecolor": "white",
        "markeredgewidth": 1.0,
        "zorder": 7,
        "linestyle": "none",
    }
    ax.plot(*states[trace.cusps, :2].T, CUSP_MARK, color=INK, markersize=5, **style)
    ax.plot(*states[0, :2], "o", color=START_COLOUR, markersize=7, **style)
    ax.plot(*episode.goal, "*", color=GOAL_COLOUR, markersize=13, **style)
    if episode.outcome == "collided":
        ax.plot(*states[-1, :2], "X", color=CRASH_COLOUR, markersize=11, **style)
    elif episode.outcome != "reached":
        ax.plot(*states[-1, :2], "s", color=INK, markersize=7, **style)
    bare(ax)
    return line


def _title(ax: Axes, arm: str, episode: DriveResult) -> None:
    # One above the other: side by side they would run into each other where panels are narrow.
    ax.set_title(arm, loc="left", fontsize=10, color=arm_colour(arm), fontweight="bold", pad=17)
    word = episode.outcome.replace("_", " ")
    impact = episode.impact_speed
    if episode.outcome == "collided" and impact is not None:
        word += f" at {impact:.1f} m/s"
    colour = INK if episode.outcome == "reached" else CRASH_COLOUR
    ax.annotate(
        f"{word} · {episode.verdict}",
        (0, 1),
        (0, 4),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=9,
        color=colour,
    )
