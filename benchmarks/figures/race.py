"""The race: the drives of several arms in one building, side by side, with running clocks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchmarks.figures.animation import Ticks, roll_out
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
from benchmarks.runs.arms import arm_kind, arm_risk
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.infra.drawing import INK, bare, new_figure, own_style
from foresee.mapping.grid import GridFrame

ARMS = {
    "known": "plans within what it has seen",
    "backup": "hopes that the rest is free",
    "predicted": "relies on a network",
}
"""Kind of arm that races → what it does, in a few words."""
MARGIN = 2.5
"""Margin around the drives [m]."""
WALL, STOP = "#888888", "#F4A6A6"
"""Colours of the true walls, and of the last resort."""
MOST = 150
"""Largest number of frames."""
LARGEST = 360
"""Largest side of the image of a map [pixels]."""
LARGEST_FIGURE = np.array([8.4, 6.4])
"""Largest width and height of all panels together [inch]; a page of a repository is as wide."""
NARROWEST = 6.5
"""Least width of a frame, for the legend [inch]."""
HEAD, FOOT = 0.42, 0.48
"""Height of the head of a panel, and of the legend [inch]."""
DPI = 100


def racers(run: Run, index: int) -> list[str]:
    """Return the arms that race in an episode: of `predicted`, the one at the highest risk.

    Raises:
        RunError: if there is no such episode, or fewer than two of `ARMS` drove it.
    """
    driven = run.driven_arms(index)
    boldest = {arm_kind(arm): arm for arm in sorted(driven, key=arm_risk)}
    arms = [boldest[kind] for kind in ARMS if kind in boldest]
    if len(arms) < 2:
        raise RunError(
            f"{run.directory}: a race needs two of the arms {', '.join(ARMS)}, and episode {index} "
            f"has {', '.join(driven)}"
        )
    return arms


class Race(Ticks):
    """The frames of a race, drawn one by one by `frame`, in real time.

    Args:
        run: run that contains the drives.
        index: number of the episode; None: the first in which all arms reached the goal.

    Attributes:
        index: number of the episode.

    Raises:
        RunError: if there is no such episode, fewer than two of `ARMS` drove it, or a trace is
            broken.
    """

    @own_style()
    def __init__(self, run: Run, index: int | None = None) -> None:
        self.index = index = run.showcase if index is None else index
        arms = racers(run, index)
        traces = [run.trace(index, arm) for arm in arms]
        longest = max(len(trace.plans) for trace in traces)
        super().__init__(longest, run.setting("dt"), math.ceil(longest / MOST))
        result = run.drives[index, arms[0]]
        points = np.vstack([result.goal, *(trace.states[:, :2] for trace in traces)])
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        # In a row or in a column, whichever makes the panels larger.
        box, count = high - low, np.array([len(arms), 1])
        scales = [float((LARGEST_FIGURE / (box * panels)).min()) for panels in (count, count[::-1])]
        across, size = scales[0] >= scales[1], max(scales) * box
        rows, cols = (1, len(arms)) if across else (len(arms), 1)
        figure = new_figure(
            max(size[0] * cols, NARROWEST), (size[1] + HEAD) * rows + FOOT, layout=None
        )
        whole = figure.get_figheight()
        figure.subplots_adjust(0.005, FOOT / whole, 0.995, 1 - HEAD / whole, 0.03, HEAD / size[1])
        figure.set_dpi(DPI)
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.subplots(rows, cols, squeeze=False).ravel()
        self._panels = [
            _Panel(ax, run, index, arm, (low[0], high[0], low[1], high[1]))
            for ax, arm in zip(axes, arms, strict=True)
        ]
        scale_bar(axes[0])
        areas = [
            swatch(FREE_COLOUR, "seen"),
            swatch(UNKNOWN_COLOUR, "not seen"),
            swatch(BELIEVED_FREE, "expected free"),
            swatch(BELIEVED_OCCUPIED, "expected wall"),
        ]
        # Columns of two.
        handles = [*areas, *self._panels[0].lines, *_marks()]
        figure.legend(handles=handles, loc="lower center", ncols=4, **LEGEND)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Draw one frame, and return its pixels, (height, width, 3)."""
        for panel in self._panels:
            panel.update(self.ticks[number])
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def _marks() -> list[Line2D]:
    wall = Line2D([], [], color=WALL, linewidth=0.8, label="true wall, unknown to the car")
    return [wall, Line2D([], [], label="goal", **MARKS["goal"] | {"markersize": 10})]


class _Panel:
    """The drive of one arm: what it has observed and believes, its plan, and its clock."""

    def __init__(
        self, ax: Axes, run: Run, index: int, arm: str, box: tuple[float, float, float, float]
    ) -> None:
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
        self.lines = (
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
        note(ax, ARMS[arm_kind(arm)], (0, 1), (1, 4), **words | {"fontsize": 8})
        self._clock = note(ax, "", (1, 1), (-1, 16), ha="right", weight="bold", **words)
        self._speed = note(ax, "", (1, 1), (-1, 4), ha="right", **words | {"fontsize": 9})

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
        for line, motions in zip(self.lines, self._motions, strict=True):
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
