"""The race: the drives of several arms in one building, side by side, with running clocks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from benchmarks.figures.animation import MARGIN, Ticks, roll_out
from benchmarks.figures.moment import BELIEVED_FREE, BELIEVED_OCCUPIED
from benchmarks.figures.palette import (
    CRASH_COLOUR,
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
    outline,
    scale_bar,
    swatch,
)
from benchmarks.figures.video import write_video
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.infra.drawing import INK, bare, new_figure, own_style, short_name
from foresee.mapping.grid import GridFrame

ARMS = ("known", "backup", "predicted")
"""Arms that race."""
MOST = 130
"""Largest number of frames."""
LARGEST = 360
"""Largest side of the image of a map [pixels]."""
LARGEST_FIGURE = np.array([10.5, 8.5])
"""Largest width and height of all panels together [inch]."""
NARROWEST = 6.5
"""Least width of a frame, for the legend [inch]."""
DPI = 90


def write_race(run: Run, folder: Path, index: int | None = None) -> Path:
    """Write race-EPISODE.gif, with a progress bar, and return its path.

    Args:
        run: run that contains the drives.
        folder: folder for the file.
        index: number of the episode; None: the first in which all arms reached the goal.

    Raises:
        RunError: if there is no such episode, fewer than two of `ARMS` drove it, or a trace is
            broken.
    """
    race = Race(run, run.showcase if index is None else index)
    path = folder / f"race-{race.index}.gif"
    write_video(race.frame, len(race), race.rate, path)
    return path


class Race(Ticks):
    """The frames of a race, drawn one by one by `frame`, in real time.

    Args:
        run: run that contains the drives.
        index: number of the episode.

    Raises:
        RunError: if there is no such episode, fewer than two of `ARMS` drove it, or a trace is
            broken.
    """

    @own_style()
    def __init__(self, run: Run, index: int) -> None:
        arms = [arm for arm in ARMS if arm in run.driven_arms(index)]
        if len(arms) < 2:
            raise RunError(
                f"{run.directory}: a race needs two of the arms {', '.join(ARMS)}, and episode "
                f"{index} has {', '.join(run.driven_arms(index))}"
            )
        self.index = index
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
            max(size[0] * cols, NARROWEST), (size[1] + 0.3) * rows + 0.75, layout=None
        )
        whole = figure.get_figheight()
        figure.subplots_adjust(0.01, 0.42 / whole, 0.99, 1 - 0.63 / whole, 0.03, 0.3 / size[1])
        figure.set_dpi(DPI)
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.subplots(rows, cols, squeeze=False).ravel()
        self._panels = [
            _Panel(ax, run, index, arm, (low[0], high[0], low[1], high[1]))
            for ax, arm in zip(axes, arms, strict=True)
        ]
        style: dict[str, Any] = {"fontsize": 11, "color": INK, "va": "center"}
        name = f"episode {index} · {short_name(result.world)}"
        figure.text(0.01, 1 - 0.16 / whole, name, **style)
        plan, stop = self._panels[0].lines
        areas = [
            swatch(FREE_COLOUR, "observed"),
            swatch(BELIEVED_FREE, "predicted free"),
            swatch(BELIEVED_OCCUPIED, "predicted occupied"),
        ]
        figure.legend(handles=[*areas, plan, stop], loc="lower left", ncols=5, **LEGEND)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Draw one frame, and return its pixels, (height, width, 3)."""
        for panel in self._panels:
            panel.update(self.ticks[number])
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


class _Panel:
    """The drive of one arm: what it has observed and believes, its plan, and its clock."""

    def __init__(
        self, ax: Axes, run: Run, index: int, arm: str, box: tuple[float, float, float, float]
    ) -> None:
        self._trace, self._result = run.trace(index, arm), run.drives[index, arm]
        self._dt, self._body, self._arm = run.setting("dt"), run.body, arm
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
        outline(ax, truth, "#AAAAAA", 0.6)
        line: dict[str, Any] = {"solid_capstyle": "round", "zorder": 5}
        colour = arm_colour(arm)
        self._driven = ax.plot([], [], color=colour, linewidth=1.5, **line)[0]
        self.lines = (
            ax.plot([], [], color=INK, linewidth=2.8, label="plan", **line)[0],
            ax.plot([], [], ":", color=CRASH_COLOUR, linewidth=1.5, label="last resort", zorder=6)[
                0
            ],
        )
        self._car = draw_body(ax, states[0, :3], self._body, arm)
        ax.plot(*self._result.goal, **MARKS["goal"] | {"markersize": 12})
        bare(ax)
        ax.axis(box)
        scale_bar(ax)
        self._title = ax.set_title("", loc="left", fontsize=10, color=colour, fontweight="bold")

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
        self._car.set_xy(body_outline(here, self._body))
        if over:
            text = f"{self._result.outcome.replace('_', ' ')} · {self._result.time:.1f} s"
        else:
            text = f"{tick * self._dt:.1f} s · {here[3]:.1f} m/s"
        self._title.set_text(f"{self._arm} · {text}")

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
