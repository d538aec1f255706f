"""Speed over the distance driven, and what limited it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from benchmarks.figures.palette import (
    INK,
    LIMIT_COLOURS,
    OUTCOME_MARKS,
    arm_colour,
    limit_colour,
    new_figure,
)
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError, Trace

DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)))
"""Line styles that tell runs apart."""


@dataclass(frozen=True, eq=False)
class _Drive:
    """One line of the figure."""

    label: str
    arm: str
    run: int
    outcome: str
    verdict: str
    trace: Trace


def speed_profile(runs: Sequence[Run], index: int | None = None) -> Figure:
    """Draw one episode's speed over distance for each arm of each run, and its limits.

    Speeds in reverse are drawn below zero.

    Args:
        runs: one or more; each gives its own lines.
        index: which episode; by default the first that all arms of the first run reached.

    Raises:
        RunError: if no run has such an episode, or a trace is broken.
    """
    if index is None:
        index = runs[0].showcase
    drives = _drives(runs, index)
    scored = all(episode.sct is not None for run in runs for episode in run.episodes)
    many = scored and max(len(run.indices) for run in runs) > 1
    strip = 0.27
    figure = new_figure(10, 3.9 + strip * len(drives) + 0.5)
    axes = figure.subplots(
        2,
        2 if many else 1,
        squeeze=False,
        sharex="col",
        height_ratios=(3.6, strip * len(drives) + 0.1),
        width_ratios=(5.2, 1) if many else (1,),
    )
    v_max = max(run.setting("v_max", 4.0) for run in runs)
    _profiles(axes[0, 0], drives, v_max)
    _strips(axes[1, 0], drives, room=many)
    world = runs[0].drives[index, runs[0].arms_of(index)[0]].world
    # Above the legend, where that is too wide to stand beside it.
    pad = 22 if len(drives) > 3 else 6
    axes[0, 0].set_title(f"Episode {index} · {world}", loc="left", fontsize=11, color=INK, pad=pad)
    if many:
        _all_episodes(axes[0, 1], runs, drives)
        axes[1, 1].set_visible(False)
    used = {limit for drive in drives for limit in drive.trace.limits}
    order = [limit for limit in LIMIT_COLOURS if limit in used] + sorted(used - set(LIMIT_COLOURS))
    patches = [
        Patch(facecolor=limit_colour(limit), edgecolor="#888888", linewidth=0.5, label=limit)
        for limit in order
    ]
    figure.legend(
        handles=patches,
        loc="outside lower center",
        ncols=len(patches),
        frameon=False,
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
    drives = []
    for number, run in enumerate(runs):
        for arm in run.arms_of(index):
            episode = run.drives.get((index, arm))
            if episode is None:
                raise RunError(f"{run.directory} has no episode {index} of arm {arm!r}")
            drives.append(
                _Drive(
                    label=arm if len(runs) == 1 else f"{labels[number]}: {arm}",
                    arm=arm,
                    run=number,
                    outcome=episode.outcome,
                    verdict=episode.verdict,
                    trace=run.trace(index, arm),
                )
            )
    return drives


def _profiles(ax: Axes, drives: list[_Drive], v_max: float) -> None:
    ax.axhline(v_max, color="#999999", linewidth=0.8, linestyle=(0, (2, 2)))
    ax.annotate(
        "top speed of the car",
        (0, v_max),
        (2, 2),
        textcoords="offset points",
        fontsize=8,
        color="#777777",
    )
    for drive in drives:
        colour = arm_colour(drive.arm)
        speed, distance = drive.trace.states[:, 3], drive.trace.distance
        ax.plot(
            distance,
            speed,
            color=colour,
            linewidth=1.8,
            label=drive.label,
            linestyle=DASHES[drive.run % len(DASHES)],
        )
        ax.plot(
            distance[-1],
            speed[-1],
            OUTCOME_MARKS.get(drive.outcome, "o"),
            color=colour,
            markersize=9 if drive.outcome == "collided" else 5,
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
        ax.annotate(
            "in reverse",
            (1, 0),
            (-2, -2),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=8,
            color="#777777",
            ha="right",
            va="top",
        )
    ax.set_ylabel("speed [m/s]")
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        frameon=False,
        fontsize=9,
        ncols=6 if len(drives) <= 6 and drives[-1].run == 0 else 3,
        borderaxespad=0.2,
        handlelength=2.2,
        columnspacing=1.4,
    )
    _plain(ax)


def _strips(ax: Axes, drives: list[_Drive], room: bool) -> None:
    """Draw the limits; `room`: whether there is space to the right for texts."""
    for row, drive in enumerate(drives):
        distance, limits = drive.trace.distance, drive.trace.limits
        ax.broken_barh(
            list(zip(distance[:-1], np.diff(distance), strict=True)),
            (row - 0.4, 0.8),
            facecolors=[limit_colour(limit) for limit in limits],
            linewidth=0,
        )
        word = "" if drive.outcome == "reached" else f"{drive.outcome.replace('_', ' ')} · "
        ax.annotate(
            f" {word}{drive.verdict}",
            (distance[-1], row),
            (4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=INK,
            annotation_clip=False,
        ).set_in_layout(not room)
    ax.set_ylim(len(drives) - 0.5, -0.5)
    ax.set_yticks(range(len(drives)), [drive.label for drive in drives], fontsize=9)
    for tick, drive in zip(ax.get_yticklabels(), drives, strict=True):
        tick.set_color(arm_colour(drive.arm))
    ax.set_xlabel("distance driven [m]")
    ax.tick_params(axis="y", length=0)
    for side in ("top", "right", "left"):
        ax.spines[side].set_visible(False)


def _all_episodes(ax: Axes, runs: Sequence[Run], drives: list[_Drive]) -> None:
    """SCT of each episode, a column for each line, so that one drive is not all one sees."""
    rng = np.random.default_rng(0)
    for column, drive in enumerate(drives):
        episodes = [e for e in runs[drive.run].episodes if e.arm == drive.arm]
        x = column + rng.uniform(-0.2, 0.2, len(episodes))
        scores = np.array([np.nan if e.sct is None else e.sct for e in episodes])
        for mark in sorted(set(OUTCOME_MARKS.values())):
            here = [i for i, e in enumerate(episodes) if OUTCOME_MARKS.get(e.outcome) == mark]
            ax.scatter(
                x[here],
                scores[here],
                marker=mark,
                s=30 if mark == "X" else 12,
                color=arm_colour(drive.arm),
                alpha=0.55,
                linewidths=0,
            )
        mean = np.mean(scores)
        ax.plot([column - 0.35, column + 0.35], [mean, mean], color=INK, linewidth=1.6)
    count = max(len(run.indices) for run in runs)
    ax.set_title(f"SCT,\nall {count} episodes", fontsize=9, color=INK)
    ax.set_xlim(-0.6, len(drives) - 0.4)
    ax.set_xticks([])
    ax.set_ylim(-0.03, 1.03)
    _plain(ax)


def _plain(ax: Axes) -> None:
    ax.grid(axis="y", color="#E5E5E5", linewidth=0.7)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
