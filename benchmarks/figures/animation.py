"""A drive as a moving picture: the map as it becomes known, the plan, and the speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from benchmarks.figures.palette import (
    INK,
    LIMIT_COLOURS,
    RELIED_COLOUR,
    SPEED_COLOURS,
    UNKNOWN_COLOUR,
    arm_colour,
    bare,
    body_outline,
    draw_body,
    extent,
    limit_colour,
    map_image,
    scale_bar,
)
from benchmarks.runs.saved_run import Run
from predictor.mapping.body import Body
from predictor.mapping.conventions import TICK
from predictor.mapping.grid import FREE, GridFrame, paste
from sim.car import along_arc

DPI = 100
SIZE = (8.4, 6.2)
"""Of a frame [inch]."""
MARGIN = 2.0
"""Shown of the building around the drive [m]."""
OVERVIEW = 320
"""Largest side of the small map [cells]."""


def roll_out(
    state: NDArray[np.float64], controls: NDArray[Any], dt: float, gear: float = 1.0
) -> NDArray[np.float64]:
    """Return the states (N+1, 4) of a car under controls (N, 2); see `sim.car`.

    Args:
        state: x, y, yaw, v at the start, (4,).
        controls: of each step, in one gear throughout.
        dt: of a step [s].
        gear: 1 or -1; a car that moves stays in the gear of its motion.
    """
    gear = math.copysign(1.0, state[3]) if state[3] != 0 else gear
    states = np.empty((len(controls) + 1, 4))
    states[0] = state
    for k, (a, curvature) in enumerate(np.asarray(controls, dtype=np.float64)):
        x, y, yaw, v = states[k]
        # Saved plans are rounded: that must not make the car roll back at its stop.
        length = gear * max(abs(v) * dt + 0.5 * a * dt**2, 0.0)
        speed = max(abs(v) + a * dt, 0.0)
        states[k + 1] = *along_arc(x, y, yaw, curvature, length), gear * speed
    return states


class Animation:
    """The frames of one drive; each can be drawn at will.

    Args:
        run: whose drive.
        index: which episode; by default the first that all arms reached the goal in.
        arm: whose; by default the one that predicts.
        stride: ticks from frame to frame; by default as many as keep to `most` frames.
        most: frames at most, where no stride is given.

    Raises:
        RunError: if there is no such drive, or its trace is broken.
    """

    def __init__(
        self,
        run: Run,
        index: int | None = None,
        arm: str | None = None,
        stride: int | None = None,
        most: int = 400,
    ) -> None:
        self.index = run.showcase if index is None else index
        self.arm = run.pick_arm(self.index, arm)
        self.dt = run.setting("dt", TICK)
        self._trace = trace = run.trace(self.index, self.arm)
        self._truth = run.truth(self.index)
        self._first_seen = trace["first_seen"]
        self._plans = trace["plans"]
        self._relied = trace.relied
        self._v_max = run.setting("v_max", 4.0)
        self._window = run.setting("window", 5.0)
        total = len(self._plans)
        self.stride = max(1, math.ceil(total / most)) if stride is None else stride
        # The last tick is always shown: that is where a drive ends well or badly.
        self.ticks = sorted({*range(0, total, self.stride), *range(total - 1, total)})
        episode = run.drives[self.index, self.arm]
        self._outcome = episode.outcome
        self._goal = episode.goal
        self._figure = Figure(figsize=SIZE, dpi=DPI)
        self._canvas = FigureCanvasAgg(self._figure)
        self._title = self._figure.text(0.02, 0.965, "", fontsize=11, color=INK, va="center")
        about = "white: seen · orange: relied on unseen · line: plan to a stop"
        self._figure.text(0.98, 0.965, about, fontsize=8, color=INK, va="center", ha="right")
        self._name = f"{self.arm} · episode {self.index} · {episode.world}"
        self._near = _Near(self._figure.add_axes((0.02, 0.31, 0.46, 0.623)), self)
        self._far = _Far(self._figure.add_axes((0.50, 0.31, 0.48, 0.623)), self)
        self._speed = _Speed(self._figure, self)
        self._crashes = [
            ax.plot(
                *trace.states[-1, :2],
                "X",
                color="#C00000",
                markersize=12,
                markeredgecolor="white",
                zorder=7,
            )[0]
            for ax in self._figure.axes[:2]
        ]

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def rate(self) -> float:
        """Frames a second for real time [1/s]."""
        return 1.0 / (self.dt * self.stride)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Return one frame, (height, width, 3)."""
        tick = self.ticks[number]
        state = self._trace.states[tick]
        is_last = number == len(self) - 1
        end = f" · {self._outcome.replace('_', ' ')}" if is_last else ""
        self._title.set_text(f"{self._name} · {tick * self.dt:5.1f} s · {state[3]:4.2f} m/s{end}")
        for crash in self._crashes:
            crash.set_visible(is_last and self._outcome == "collided")
        for part in (self._near, self._far, self._speed):
            part.update(tick)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def seen(self, tick: int) -> NDArray[np.int8]:
        """Return the true map where it has been seen by a tick, unknown elsewhere."""
        seen = (self._first_seen > 0) & (self._first_seen <= tick + 1)
        return np.where(seen, self._truth.cells, np.int8(-1))


class _Near:
    """The surroundings of the car: what is seen, what the plan relies on, the plan."""

    def __init__(self, ax: Axes, show: Animation) -> None:
        self._ax, self._show = ax, show
        self._side = 12.0 if show._window <= 10 else 18.0
        truth = show._truth
        ax.set_facecolor(UNKNOWN_COLOUR)
        self._image = ax.imshow(np.zeros((1, 1, 3)), origin="lower", interpolation="nearest")
        x, y = truth.frame.centres()
        ax.contour(
            x, y, (truth.cells == FREE).astype(float), [0.5], colors=["#AAAAAA"], linewidths=0.8
        )
        self._square = Rectangle(
            (0, 0), 1, 1, fill=False, edgecolor=INK, linewidth=1.0, linestyle=(0, (4, 2))
        )
        ax.add_patch(self._square)
        self._driven = _coloured(ax, show._v_max, 2.0)
        self._rim = ax.plot([], [], color="white", linewidth=5.0, zorder=4)[0]
        self._plan = _coloured(ax, show._v_max, 3.0)
        self._body = draw_body(ax, np.zeros(3), Body(), arm_colour(show.arm))
        ax.plot(*show._goal, "*", color="#009E73", markersize=14, markeredgecolor="white", zorder=5)
        bare(ax)
        half = self._side / 2
        ax.set_xlim(-half, half)
        ax.set_ylim(-half, half)

    def update(self, tick: int) -> None:
        show = self._show
        truth, states = show._truth, show._trace.states
        x, y = float(states[tick, 0]), float(states[tick, 1])
        part = truth.frame.square(x, y, self._side + 0.2)
        image = map_image(paste(truth.frame, show.seen(tick), part, np.int8(-1)))
        self._mark_relied(image, part, tick)
        self._image.set_data(image)
        self._image.set_extent(extent(part))
        self._ax.set_xlim(x - self._side / 2, x + self._side / 2)
        self._ax.set_ylim(y - self._side / 2, y + self._side / 2)
        left, right, bottom, top = extent(truth.frame.square(x, y, show._window))
        self._square.set_bounds(left, bottom, right - left, top - bottom)
        _set_line(self._driven, states[: tick + 1])
        plan = roll_out(states[tick], show._plans[tick], show.dt, show._trace.gears[tick])
        self._rim.set_data(plan[:, 0], plan[:, 1])
        _set_line(self._plan, plan)
        self._body.set_xy(body_outline(states[tick, :3], Body()))

    def _mark_relied(self, image: NDArray[np.float64], part: GridFrame, tick: int) -> None:
        show = self._show
        cells = show._relied[tick].astype(int)
        row, col = show._truth.frame.offset(part)
        cells = cells - np.array([row, col])
        inside = ((cells >= 0) & (cells < np.array(part.shape))).all(axis=1)
        image[tuple(cells[inside].T)] = to_rgb(RELIED_COLOUR)


class _Far:
    """The whole drive: the building as far as it is known, and the way so far."""

    def __init__(self, ax: Axes, show: Animation) -> None:
        self._show = show
        states, frame = show._trace.states, show._truth.frame
        points = np.vstack([states[:, :2], [show._goal]])
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        # As wide as the axes are, so that the picture fills them.
        width, height = high - low
        ratio = 0.48 * SIZE[0] / (0.623 * SIZE[1])
        grow = np.array([max(0.0, height * ratio - width), max(0.0, width / ratio - height)]) / 2
        low, high = low - grow, high + grow
        (row, col), (row_end, col_end) = frame.cell(*low), frame.cell(*high)
        origin = frame.origin[0] + col * frame.resolution, frame.origin[1] + row * frame.resolution
        self._part = GridFrame(frame.resolution, origin, (row_end - row, col_end - col))
        ax.set_facecolor(UNKNOWN_COLOUR)
        factor = math.ceil(max(self._part.shape) / OVERVIEW)
        shown = [math.ceil(n / factor) * factor * frame.resolution for n in self._part.shape]
        self._image = ax.imshow(
            np.zeros((1, 1, 3)),
            origin="lower",
            interpolation="nearest",
            extent=(origin[0], origin[0] + shown[1], origin[1], origin[1] + shown[0]),
        )
        x, y = frame.centres()
        ax.contour(
            x,
            y,
            (show._truth.cells == FREE).astype(float),
            [0.5],
            colors=["#AAAAAA"],
            linewidths=0.6,
        )
        self._driven = _coloured(ax, show._v_max, 2.5)
        colour = arm_colour(show.arm)
        self._car = ax.plot(
            [], [], "o", color=colour, markersize=8, markeredgecolor="white", zorder=6
        )[0]
        ax.plot(*show._goal, "*", color="#009E73", markersize=12, markeredgecolor="white", zorder=5)
        bare(ax)
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
        scale_bar(ax, 10.0 if high[0] - low[0] > 25 else 5.0)

    def update(self, tick: int) -> None:
        states, truth = self._show._trace.states, self._show._truth
        cells = paste(truth.frame, self._show.seen(tick), self._part, np.int8(-1))
        self._image.set_data(map_image(cells, OVERVIEW))
        _set_line(self._driven, states[: tick + 1])
        self._car.set_data(states[tick : tick + 1, 0], states[tick : tick + 1, 1])


class _Speed:
    """Speed over time, negative in reverse, and the strip of what limited it."""

    def __init__(self, figure: Figure, show: Animation) -> None:
        limits = show._trace.limits
        self._time = np.arange(len(show._trace.states)) * show.dt
        self._speed = show._trace.states[:, 3]
        self._colours = np.array([to_rgb(limit_colour(limit)) for limit in limits])[None]
        end = float(self._time[-1])
        ax = figure.add_axes((0.075, 0.165, 0.905, 0.125))
        ax.plot(self._time, self._speed, color="#DDDDDD", linewidth=1.2)
        self._line = ax.plot([], [], color=arm_colour(show.arm), linewidth=1.8)[0]
        ax.set_xlim(0, end)
        ax.set_ylim(min(0.0, 1.2 * float(self._speed.min())), 1.05 * show._v_max)
        ax.set_ylabel("speed [m/s]", fontsize=8)
        ax.tick_params(labelsize=8, labelbottom=False, length=2)
        strip = figure.add_axes((0.075, 0.115, 0.905, 0.035))
        self._strip = strip.imshow(
            np.ones_like(self._colours),
            aspect="auto",
            interpolation="nearest",
            extent=(0, end, 0, 1),
        )
        strip.set_yticks([])
        strip.tick_params(labelsize=8, length=2)
        strip.set_xlabel("time [s]", fontsize=8, labelpad=1)
        for axes in (ax, strip):
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
        patches = [
            Patch(facecolor=limit_colour(name), label=name)
            for name in LIMIT_COLOURS
            if name in limits
        ]
        figure.legend(
            handles=patches,
            loc="lower right",
            ncols=len(patches),
            frameon=False,
            fontsize=8,
            handlelength=1.2,
            columnspacing=1.0,
            bbox_to_anchor=(0.99, -0.01),
        )

    def update(self, tick: int) -> None:
        self._line.set_data(self._time[: tick + 1], self._speed[: tick + 1])
        colours = np.ones_like(self._colours)
        colours[:, : tick + 1] = self._colours[:, : tick + 1]
        self._strip.set_data(colours)


def _coloured(ax: Axes, v_max: float, width: float) -> LineCollection:
    line = LineCollection(
        [],
        cmap=SPEED_COLOURS,
        norm=Normalize(0, v_max),
        linewidths=width,
        capstyle="round",
        zorder=5,
    )
    ax.add_collection(line)
    return line


def _set_line(line: LineCollection, states: NDArray[np.float64]) -> None:
    line.set_segments(list(np.stack([states[:-1, :2], states[1:, :2]], axis=1)))
    line.set_array(np.abs(states[:-1, 3] + states[1:, 3]) / 2)
