"""Figure parting.png: two drivers of one task in the moment in which their ways part."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.figures.drive_view import side_by_side
from benchmarks.figures.palette import DASHED, arm_colour
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.mapping.polyline import arc_length, points_at

BASELINE = "known"
"""The arm that another one is compared with."""
APART = 1.0
"""Distance from the way of the other driver at which the ways have parted [m]."""
TOGETHER = 0.3
"""Distance from it up to which both drive the same way [m]."""
SPACING = 0.05
"""Spacing of the points of a way that distances are measured to [m]."""


def parting(run: Run, index: int | None = None, arm: str | None = None) -> Figure:
    """Draw what two drivers have seen and expect when their ways part, and how each goes on.

    Args:
        run: run that contains the drives, also those of `known`.
        index: number of the episode; None: the first in which the ways part.
        arm: arm that is compared with `known`; None: one that uses a prediction.

    Raises:
        RunError: if there are no such drives, their ways do not part, or a trace is broken.
    """
    arms = [BASELINE, run.pick_arm(index, arm)]
    for number in run.indices if index is None else [index]:
        if not all((number, name) in run.drives for name in arms):
            continue
        ways = [run.trace(number, name).states[:, :2] for name in arms]
        left = [
            (arc_length(way)[tick], way[tick])
            for way, other in (ways, ways[::-1])
            if (tick := leaves(way, other)) is not None
        ]
        if left:
            _, place = min(left, key=lambda distance_and_place: distance_and_place[0])
            return _draw(run, number, arms, place)
    raise RunError(f"{run.directory}: the ways of {' and '.join(arms)} part in no such episode")


def leaves(way: NDArray[np.float64], other: NDArray[np.float64]) -> int | None:
    """Return the last tick in which a driver is on the way of another before it leaves that way.

    Args:
        way: positions of the driver from tick to tick, (n, 2) [m].
        other: positions of the other driver, which starts at the same place, (m, 2) [m].

    Returns:
        Number of the tick; None if the driver never leaves the way of the other.
    """
    length = arc_length(other)[-1]
    points = points_at(other, np.append(np.arange(0.0, length, SPACING), length))
    distance = np.asarray(cKDTree(points).query(way)[0])
    if distance.max() <= APART:
        return None
    return int(np.flatnonzero(distance[: np.argmax(distance > APART)] <= TOGETHER)[-1])


def _draw(run: Run, index: int, arms: list[str], place: NDArray[np.float64]) -> Figure:
    """Draw each drive in the tick in which it comes to the place where the ways part."""
    about = {name: f"{run.drives[index, name].time:.1f} s in all" for name in arms}
    figure, views = side_by_side(run, index, about)
    for view, name in zip(views, arms, strict=True):
        way = run.trace(index, name).states[:, :2]
        away = np.hypot(*(way - place).T)
        tick = int(np.argmax(away <= max(TOGETHER, away.min())))
        view.update(tick)
        colour = arm_colour(name)
        view.ax.plot(*way[tick:].T, color=colour, linewidth=1.2, linestyle=DASHED, zorder=3.5)
    return figure
