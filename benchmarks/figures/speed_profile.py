"""Figure speed_profile.png: speed over the distance driven, and what limited it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.figures.palette import (
    OUTCOME_MARKS,
    RIM,
    arm_colour,
    limit_colour,
    limit_patches,
    note,
)
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import Trace
from foresee.infra.drawing import INK, new_figure, short_name

DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)))
"""Line styles that tell runs apart."""
STRIP = 0.27
"""Height of a drive's strip of limits [inch]."""


@dataclass(frozen=True, eq=False)
class _Drive:
    """A drive that is drawn as one line of the figure.

    Attributes:
        label: label of the line.
        run: number of its run among those drawn.
        result: result of the drive.
        trace: arrays of the drive.
    """

    label: str
    run: int
    result: DriveResult
    trace: Trace


def speed_profile(runs: Sequence[Run], index: int | None = None) -> Figure:
    """Draw the speed over distance of each arm of each run in one episode, and its limits.

    Speeds in reverse are drawn below zero. Beside it, the SCT of all episodes is shown. Runs
    without the episode have no line.

    Args:
        runs: one or more runs.
        index: number of the episode; None: the first one in which all arms of the first run reached
            the goal.

    Raises:
        RunError: if no run has such an episode, or a trace is broken.
    """
    if index is None:
        index = runs[0].showcase
    drives = _drives(runs, index)
    scored = all(episode.sct is not None for run in runs for episode in run.episodes)
    many = scored and max(len(run.indices) for run in runs) > 1
    figure = new_figure(10, 4.4 + STRIP * len(drives))
    axes = figure.subplots(
        2,
        2 if many else 1,
        squeeze=False,
        sharex="col",
        height_ratios=(3.6, STRIP * len(drives) + 0.1),
        width_ratios=(5.2, 1) if many else (1,),
    )
    _profiles(axes[0, 0], drives, max(run.setting("v_max") for run in runs))
    _strips(axes[1, 0], drives, room=many)
    # The title is above the legend if the legend is too wide to stand beside it.
    pad = 22 if len(drives) > 3 else 6
    title = f"Episode {index} · {short_name(drives[0].result.world)}"
    axes[0, 0].set_title(title, loc="left", fontsize=11, color=INK, pad=pad)
    if many:
        _all_episodes(axes[0, 1], runs, drives)
        axes[1, 1].set_visible(False)
    patches = limit_patches((limit for drive in drives for limit in drive.trace.limits), **RIM)
    figure.legend(
        handles=patches,
        loc="outside lower center",
        ncols=len(patches),
        fontsize=9,
        title="speed limited by",
        title_fontsize=9,
        handlelength=1.4,
        columnspacing=1.4,
    )
    return figure


def _drives(runs: Sequence[Run], index: int) -> list[_Drive]:
    labels = [run.label for run in runs]
    if len(set(labels)) < len(labels):
        labels = [str(run.directory) for run in runs]
    # If no run has the episode, the first one says which it has.
    numbers = [number for number, run in enumerate(runs) if index in run.indices] or [0]
    return [
        _Drive(
            arm if len(runs) == 1 else f"{short_name(labels[number])}: {arm}",
            number,
            runs[number].drives[index, arm],
            runs[number].trace(index, arm),
        )
        for number in numbers
        for arm in runs[number].driven_arms(index)
    ]


def _profiles(ax: Axes, drives: list[_Drive], v_max: float) -> None:
    ax.axhline(v_max, color="#999999", linewidth=0.8, linestyle=(0, (2, 2)))
    note(ax, "top speed of the car", (0, v_max), (2, 2), color="#777777")
    for drive in drives:
        colour = arm_colour(drive.result.arm)
        speed, distance = drive.trace.states[:, 3], drive.trace.distance
        dashes = DASHES[drive.run % len(DASHES)]
        ax.plot(distance, speed, color=colour, linewidth=1.8, label=drive.label, linestyle=dashes)
        ax.plot(
            distance[-1],
            speed[-1],
            OUTCOME_MARKS.get(drive.result.outcome, "o"),
            color=colour,
            markersize=9 if drive.result.outcome == "collided" else 5,
            markeredgecolor="white",
            zorder=5,
            clip_on=False,
        )
    longest = max(drive.trace.distance[-1] for drive in drives)
    ax.set_xlim(0, max(longest, 0.1))
    lowest = min(float(drive.trace.states[:, 3].min()) for drive in drives)
    ax.set_ylim(min(0.0, lowest - 0.08 * v_max if lowest < 0 else 0.0), 1.12 * v_max)
    if lowest < 0:
        ax.axhline(0.0, color="#999999", linewidth=0.8)
        style = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "top"}
        note(ax, "in reverse", (1, 0), (-2, -2), color="#777777", **style)
    ax.set_ylabel("speed [m/s]")
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        fontsize=9,
        ncols=6 if len(drives) <= 6 and drives[-1].run == 0 else 3,
        borderaxespad=0.2,
        handlelength=2.2,
        columnspacing=1.4,
    )
    _plain(ax)


def _strips(ax: Axes, drives: list[_Drive], room: bool) -> None:
    """Draw a strip for each drive with what limited its speed, and its outcome as text.

    Args:
        ax: axes of the strips.
        drives: drives.
        room: whether there is space for the texts to the right of the axes.
    """
    for row, drive in enumerate(drives):
        distance, outcome = drive.trace.distance, drive.result.outcome
        ax.broken_barh(
            list(zip(distance[:-1], np.diff(distance), strict=True)),
            (row - 0.4, 0.8),
            facecolors=[limit_colour(limit) for limit in drive.trace.limits],
            linewidth=0,
        )
        word = "" if outcome == "reached" else f"{outcome.replace('_', ' ')} · "
        text, end = f" {word}{drive.result.verdict}", (distance[-1], row)
        note(ax, text, end, (4, 0), va="center", annotation_clip=False).set_in_layout(not room)
    ax.set_ylim(len(drives) - 0.5, -0.5)
    ax.set_yticks(range(len(drives)), [drive.label for drive in drives], fontsize=9)
    for tick, drive in zip(ax.get_yticklabels(), drives, strict=True):
        tick.set_color(arm_colour(drive.result.arm))
    ax.set_xlabel("distance driven [m]")
    ax.tick_params(axis="y", length=0)
    ax.spines[["top", "right", "left"]].set_visible(False)


def _all_episodes(ax: Axes, runs: Sequence[Run], drives: list[_Drive]) -> None:
    """Draw the SCT of all episodes, with a column for each line of the figure."""
    rng = np.random.default_rng(0)
    for column, drive in enumerate(drives):
        arm = drive.result.arm
        episodes = [e for e in runs[drive.run].episodes if e.arm == arm]
        x = column + rng.uniform(-0.2, 0.2, len(episodes))
        scores = np.array([e.sct for e in episodes])
        marks = np.array([OUTCOME_MARKS.get(e.outcome, "") for e in episodes])
        for mark in sorted(OUTCOME_MARKS.values()):
            here, size = marks == mark, 30 if mark == "X" else 12
            style: dict[str, Any] = {"color": arm_colour(arm), "alpha": 0.55, "linewidths": 0}
            ax.scatter(x[here], scores[here], size, marker=mark, **style)
        mean = np.mean(scores)
        ax.plot([column - 0.35, column + 0.35], [mean, mean], color=INK, linewidth=1.6)
    count = max(len(run.indices) for run in runs)
    ax.set_title(f"SCT,\nall {count} episodes", fontsize=9, color=INK)
    ax.set(xlim=(-0.6, len(drives) - 0.4), xticks=[], ylim=(-0.03, 1.03))
    _plain(ax)


def _plain(ax: Axes) -> None:
    ax.grid(axis="y", color="#E5E5E5", linewidth=0.7)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
