"""The view of one drive at a tick: what the car has observed and believes, its plan, its clock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchmarks.figures.animation import roll_out
from benchmarks.figures.moment import BELIEVED_FREE, BELIEVED_OCCUPIED
from benchmarks.figures.palette import (
    FREE_COLOUR,
    LEGEND,
    MARKS,
    UNKNOWN_COLOUR,
    arm_colour,
    body_outline,
    draw_body,
    draw_image,
    extent,
    map_image,
    note,
    outline,
    scale_bar,
    swatch,
)
from benchmarks.runs.saved_run import Run
from foresee.infra.drawing import INK, bare, new_figure
from foresee.mapping.grid import GridFrame

MARGIN = 2.5
"""Margin around the drives [m]."""
LARGEST_FIGURE = np.array([8.4, 6.4])
"""Largest width and height of all views together [inch]; a page of a repository is as wide."""
NARROWEST = 6.5
"""Least width of a figure, for the legend [inch]."""
HEAD, FOOT = 0.42, 0.48
"""Height of the names and clocks above a view, and of the legend [inch]."""
WALL, STOP = "#888888", "#F4A6A6"
"""Colours of the true walls, and of the last resort."""
LARGEST = 360
"""Largest side of the image of a map [pixels]."""


class DriveView:
    """Draws one tick of a drive after another into the same axes.

    Args:
        ax: axes to draw in.
        run: run that contains the drive.
        index: number of the episode.
        arm: arm that drove.
        box: left, right, bottom and top of the part of the building to show [m].
        about: a few words about the drive.

    Attributes:
        ax: axes in which it is drawn.
    """

    def __init__(
        self,
        ax: Axes,
        run: Run,
        index: int,
        arm: str,
        box: tuple[float, float, float, float],
        about: str,
    ) -> None:
        self.ax = ax
        self._trace, self._result = run.trace(index, arm), run.drives[index, arm]
        self._dt, self._body = run.setting("dt"), run.body
        states = self._trace.states[:-1]
        self._motions = [
            roll_out(states, self._trace.read(name), self._dt, self._trace.gears)[..., :2]
            if name in self._trace
            else np.empty((len(states), 0, 2))
            for name in ("plans", "last_resorts")
        ]
        truth = self._trace.truth
        (row, col), (row_end, col_end) = (truth.frame.cell(*box[k::2]) for k in (0, 1))
        resolution, (x, y) = truth.frame.resolution, truth.frame.origin
        origin = x + col * resolution, y + row * resolution
        self._part = GridFrame(resolution, origin, (row_end - row, col_end - col))
        ax.set_facecolor(UNKNOWN_COLOUR)
        self._belief = ax.imshow(np.zeros((1, 1, 4)), zorder=1)
        self._known = draw_image(ax, self._observed(0), self._part)
        self._known.set_zorder(1.5)
        outline(ax, truth, WALL, 0.8)
        colour = arm_colour(arm)
        line: dict[str, Any] = {"solid_capstyle": "round"}
        self._driven = ax.plot([], [], color=colour, linewidth=1.6, zorder=4, **line)[0]
        # The plan lies on the last resort, so that both are seen where they are the same.
        self._lines = (
            ax.plot([], [], color=INK, linewidth=1.6, label="plan", zorder=6, **line)[0],
            ax.plot(
                [], [], color=STOP, linewidth=5, label="last resort: stops it", zorder=5, **line
            )[0],
        )
        place: dict[str, Any] = {"color": colour, "alpha": 0.3, "markeredgewidth": 0}
        self._place = ax.plot([], [], "o", markersize=15, zorder=5.5, **place)[0]
        self._car = draw_body(ax, states[0, :3], self._body, arm)
        self._car.set(zorder=7, edgecolor="none")
        ax.plot(*self._result.goal, **MARKS["goal"] | {"markersize": 12})
        bare(ax)
        ax.axis(box)
        words: dict[str, Any] = {"xycoords": "axes fraction", "fontsize": 10}
        note(ax, arm, (0, 1), (1, 16), color=colour, weight="bold", **words)
        note(ax, about, (0, 1), (1, 4), **words | {"fontsize": 8})
        self._clock = note(ax, "", (1, 1), (-1, 16), ha="right", weight="bold", **words)
        self._speed = note(ax, "", (1, 1), (-1, 4), ha="right", **words | {"fontsize": 9})

    @property
    def legend(self) -> list[Patch | Line2D]:
        """Entries of a legend for all that is drawn, in columns of two."""
        areas = [
            swatch(FREE_COLOUR, "seen"),
            swatch(UNKNOWN_COLOUR, "not seen"),
            swatch(BELIEVED_FREE, "expected free"),
            swatch(BELIEVED_OCCUPIED, "expected wall"),
        ]
        wall = Line2D([], [], color=WALL, linewidth=0.8, label="true wall, unknown to the car")
        goal = Line2D([], [], label="goal", **MARKS["goal"] | {"markersize": 10})
        return [*areas, *self._lines, wall, goal]

    def update(self, tick: int) -> None:
        """Show a tick, or the last one of the drive."""
        states, last = self._trace.states, len(self._trace.plans) - 1
        over, tick = tick >= last, min(tick, last)
        self._known.set_data(self._observed(tick))
        believed = self._trace.belief(tick)
        if believed is not None:
            self._belief.set_data(_shades(believed[0]))
            self._belief.set_extent(extent(believed[1]))
        here = states[len(states) - 1 if over else tick]
        self._driven.set_data(*states[: tick + 1, :2].T)
        for line, motions in zip(self._lines, self._motions, strict=True):
            line.set_data(*motions[tick].T)
            line.set_visible(not over)
        self._place.set_data(here[:1], here[1:2])
        self._car.set_xy(body_outline(here, self._body))
        self._clock.set_text(f"{self._result.time if over else tick * self._dt:.1f} s")
        outcome = self._result.outcome.replace("_", " ")
        self._speed.set_text(outcome if over else f"{here[3]:.1f} m/s")

    def _observed(self, tick: int) -> NDArray[np.float64]:
        """Return the image of what was observed, transparent elsewhere, (rows, columns, 4)."""
        cells = self._trace.observed(tick).crop(self._part).cells
        image = map_image(cells, LARGEST)
        seen = (image != to_rgb(UNKNOWN_COLOUR)).any(axis=2)
        return np.dstack([image, seen])


def _shades(belief: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the image of beliefs (rows, columns): the surer, the less transparent."""
    colours = np.where((belief < 0)[..., None], to_rgb(BELIEVED_OCCUPIED), to_rgb(BELIEVED_FREE))
    return np.dstack([colours, np.abs(belief)])


def side_by_side(run: Run, index: int, arms: Mapping[str, str]) -> tuple[Figure, list[DriveView]]:
    """Return a figure with the views of some drives in one building, and these views.

    They lie in a row or in a column, whichever makes them larger.

    Args:
        run: run that contains the drives.
        index: number of the episode.
        arms: arm that drove → a few words about the drive.
    """
    states = [run.trace(index, arm).states[:, :2] for arm in arms]
    points = np.vstack([run.drives[index, next(iter(arms))].goal, *states])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    box, count = high - low, np.array([len(arms), 1])
    scales = [float((LARGEST_FIGURE / (box * views)).min()) for views in (count, count[::-1])]
    across, size = scales[0] >= scales[1], max(scales) * box
    rows, cols = (1, len(arms)) if across else (len(arms), 1)
    figure = new_figure(max(size[0] * cols, NARROWEST), (size[1] + HEAD) * rows + FOOT, layout=None)
    whole = figure.get_figheight()
    figure.subplots_adjust(0.005, FOOT / whole, 0.995, 1 - HEAD / whole, 0.03, HEAD / size[1])
    axes = figure.subplots(rows, cols, squeeze=False).ravel()
    shown = low[0], high[0], low[1], high[1]
    views = [
        DriveView(ax, run, index, arm, shown, about)
        for ax, (arm, about) in zip(axes, arms.items(), strict=True)
    ]
    scale_bar(axes[0])
    figure.legend(handles=views[0].legend, loc="lower center", ncols=4, **LEGEND)
    return figure, views
