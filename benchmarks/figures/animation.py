"""The frames of the video of a drive: the map as it becomes known, the plan, and the speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike, NDArray

from benchmarks.figures.palette import (
    DASHED,
    LEGEND,
    MARKS,
    RELIED_COLOUR,
    UNKNOWN_COLOUR,
    arm_colour,
    body_outline,
    draw_body,
    draw_image,
    extent,
    limit_colour,
    limit_patches,
    map_image,
    outline,
    scale_bar,
    set_line,
    speed_line,
)
from benchmarks.runs.saved_run import Run
from foresee.infra.drawing import INK, bare, new_figure, own_style, short_name
from foresee.mapping.grid import Grid, GridFrame

DPI = 100
SIZE = (8.4, 6.2)
"""Width and height of a frame [inch]."""
PANELS = (0.02, 0.31, 0.46, 0.623), (0.50, 0.31, 0.48, 0.623)
"""Left, bottom, width and height of the two maps in a frame, as shares of its size."""
MARGIN = 2.0
"""Margin around the whole drive in the right map [m]."""
OVERVIEW = 320
"""Largest side of the image of the right map [pixels]."""
MOST = 400
"""Largest number of frames if no stride is given."""


def roll_out(
    state: NDArray[np.float64], controls: NDArray[Any], dt: float, gear: ArrayLike = 1.0
) -> NDArray[np.float64]:
    """Compute the states (…, N+1, 4) of a car under controls; see `sim.car`.

    Args:
        state: x, y, yaw, v at the start, (…, 4).
        controls: acceleration [m/s²] and curvature [1/m] of each step, (…, N, 2), all in one gear.
        dt: duration of a step [s].
        gear: 1 or -1, (…); a car that already moves stays in the gear of its motion.
    """
    a, curvature = np.moveaxis(np.asarray(controls, dtype=np.float64), -1, 0)
    gear = np.where(state[..., 3] != 0, np.sign(state[..., 3]), gear)
    states = np.empty((*a.shape[:-1], a.shape[-1] + 1, 4))
    states[..., 0, :] = state
    for k in range(a.shape[-1]):
        x, y, yaw, v = np.moveaxis(states[..., k, :], -1, 0)
        # Clipped, since saved plans are rounded: the car must not roll back at its stop.
        length = gear * np.maximum(np.abs(v) * dt + 0.5 * a[..., k] * dt**2, 0.0)
        half = 0.5 * curvature[..., k] * length
        chord = length * np.sinc(half / np.pi)
        after = states[..., k + 1, :]
        after[..., 0] = x + chord * np.cos(yaw + half)
        after[..., 1] = y + chord * np.sin(yaw + half)
        after[..., 2] = np.remainder(yaw + 2 * half + np.pi, 2 * np.pi) - np.pi
        after[..., 3] = gear * np.maximum(np.abs(v) + a[..., k] * dt, 0.0)
    return states


class Ticks:
    """Which tick each frame of a video shows.

    Args:
        total: number of ticks of the drive.
        dt: duration of a tick [s].
        stride: number of ticks from frame to frame.

    Attributes:
        ticks: tick of each frame.
    """

    def __init__(self, total: int, dt: float, stride: int) -> None:
        # The last tick is always shown, since it shows the outcome.
        self.ticks = sorted({*range(0, total, stride), *range(total - 1, total)})
        self.rate = 1.0 / (dt * stride)
        """Frame rate at which the video runs in real time [1/s]."""

    def __len__(self) -> int:
        return len(self.ticks)


class Animation(Ticks):
    """The frames of the video of one drive, drawn one by one by `frame`.

    Args:
        run: run that contains the drive.
        index: number of the episode; None: the first in which all arms reached the goal.
        arm: arm that drove; None: one that uses a prediction.
        stride: number of ticks from frame to frame; None: the smallest that gives at most `MOST`
            frames.

    Attributes:
        trace: arrays of the drive.
        truth: true map of the building.

    Raises:
        RunError: if there is no such drive, or its trace is broken.
    """

    @own_style()
    def __init__(
        self,
        run: Run,
        index: int | None = None,
        arm: str | None = None,
        stride: int | None = None,
    ) -> None:
        self.index = run.showcase if index is None else index
        self.arm = run.pick_arm(self.index, arm)
        self.dt, self.body = run.setting("dt"), run.body
        self.trace = trace = run.trace(self.index, self.arm)
        self.truth, self.plans = trace.truth, trace.plans
        self.v_max = run.setting("v_max")
        self.window = run.setting("window")
        total = len(self.plans)
        stride = max(1, math.ceil(total / MOST)) if stride is None else stride
        super().__init__(total, self.dt, stride)
        episode = run.drives[self.index, self.arm]
        self._outcome = episode.outcome
        self.goal = episode.goal
        self._figure = new_figure(*SIZE, layout=None)
        self._figure.set_dpi(DPI)
        self._canvas = FigureCanvasAgg(self._figure)
        self._title = self._figure.text(0.02, 0.965, "", fontsize=11, color=INK, va="center")
        about = "white: observed · orange: unobserved, used by the plan · line: plan"
        self._figure.text(0.98, 0.965, about, fontsize=8, color=INK, va="center", ha="right")
        self._name = f"{self.arm} · episode {self.index} · {short_name(episode.world)}"
        near, far = (self._figure.add_axes(place) for place in PANELS)
        self._parts = (_Near(near, self), _Far(far, self), _Speed(self._figure, self))
        crash = MARKS["collision"] | {"markersize": 12}
        self._crashes = [ax.plot(*trace.states[-1, :2], **crash)[0] for ax in (near, far)]

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Draw one frame, and return its pixels, (height, width, 3)."""
        tick = self.ticks[number]
        speed = self.trace.states[tick, 3]
        is_last = number == len(self) - 1
        end = f" · {self._outcome.replace('_', ' ')}" if is_last else ""
        self._title.set_text(f"{self._name} · {tick * self.dt:5.1f} s · {speed:4.2f} m/s{end}")
        for crash in self._crashes:
            crash.set_visible(is_last and self._outcome == "collided")
        for part in self._parts:
            part.update(tick)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def seen(self, tick: int) -> Grid:
        """Return the map of what has been observed up to a tick, with the true values of cells."""
        return self.trace.observed(tick)


class _Near:
    """The left map: the car's surroundings, with observed and relied-on cells, and the plan."""

    def __init__(self, ax: Axes, show: Animation) -> None:
        self._ax, self._show = ax, show
        self._relied = show.trace.relied
        self._side = 12.0 if show.window <= 10 else 18.0
        ax.set_facecolor(UNKNOWN_COLOUR)
        self._image = ax.imshow(np.zeros((1, 1, 3)))
        outline(ax, show.truth, "#AAAAAA", 0.8)
        self._square = Rectangle((0, 0), 1, 1, fill=False, edgecolor=INK, linestyle=DASHED)
        ax.add_patch(self._square)
        self._driven = speed_line(ax, show.v_max, 2.0)
        self._rim = ax.plot([], [], color="white", linewidth=5.0, zorder=4)[0]
        self._plan = speed_line(ax, show.v_max, 3.0)
        self._body = draw_body(ax, np.zeros(3), show.body, show.arm)
        ax.plot(*show.goal, **MARKS["goal"] | {"markersize": 14, "zorder": 5})
        bare(ax)

    def update(self, tick: int) -> None:
        show = self._show
        frame, states = show.truth.frame, show.trace.states
        x, y = float(states[tick, 0]), float(states[tick, 1])
        part = frame.square(x, y, self._side + 0.2)
        image = map_image(show.seen(tick).crop(part).cells)
        cells = self._relied[tick].astype(int) - frame.offset(part)
        inside = ((cells >= 0) & (cells < part.shape)).all(axis=1)
        image[tuple(cells[inside].T)] = to_rgb(RELIED_COLOUR)
        self._image.set_data(image)
        self._image.set_extent(extent(part))
        half = self._side / 2
        self._ax.axis((x - half, x + half, y - half, y + half))
        square = frame.square(x, y, show.window)
        self._square.set_bounds(*square.origin, *square.size)
        set_line(self._driven, states[: tick + 1, :2], states[: tick + 1, 3])
        plan = roll_out(states[tick], show.plans[tick], show.dt, show.trace.gears[tick])
        self._rim.set_data(plan[:, 0], plan[:, 1])
        set_line(self._plan, plan[:, :2], plan[:, 3])
        self._body.set_xy(body_outline(states[tick], show.body))


class _Far:
    """The right map: the building as far as it has been observed, and the drive so far."""

    def __init__(self, ax: Axes, show: Animation) -> None:
        self._show = show
        states, frame = show.trace.states, show.truth.frame
        points = np.vstack([states[:, :2], [show.goal]])
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        # The shown part gets the aspect ratio of the axes, so that it fills them.
        width, height = high - low
        ratio = PANELS[1][2] * SIZE[0] / (PANELS[1][3] * SIZE[1])
        grow = np.array([max(0.0, height * ratio - width), max(0.0, width / ratio - height)]) / 2
        low, high = low - grow, high + grow
        (row, col), (row_end, col_end) = frame.cell(*low), frame.cell(*high)
        origin = frame.origin[0] + col * frame.resolution, frame.origin[1] + row * frame.resolution
        self._part = GridFrame(frame.resolution, origin, (row_end - row, col_end - col))
        ax.set_facecolor(UNKNOWN_COLOUR)
        self._image = draw_image(ax, self._seen(0), self._part)
        outline(ax, show.truth, "#AAAAAA", 0.6)
        self._driven = speed_line(ax, show.v_max, 2.5)
        car: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "zorder": 6}
        self._car = ax.plot([], [], "o", color=arm_colour(show.arm), **car)[0]
        ax.plot(*show.goal, **MARKS["goal"] | {"markersize": 12, "zorder": 5})
        bare(ax)
        ax.axis((low[0], high[0], low[1], high[1]))
        scale_bar(ax)

    def _seen(self, tick: int) -> NDArray[np.float64]:
        return map_image(self._show.seen(tick).crop(self._part).cells, OVERVIEW)

    def update(self, tick: int) -> None:
        states = self._show.trace.states[: tick + 1]
        self._image.set_data(self._seen(tick))
        set_line(self._driven, states[:, :2], states[:, 3])
        self._car.set_data(states[-1:, 0], states[-1:, 1])


class _Speed:
    """The plot below the maps: speed over time, negative in reverse, and a strip of its limits."""

    def __init__(self, figure: Figure, show: Animation) -> None:
        limits = show.trace.limits
        self._time = np.arange(len(show.trace.states)) * show.dt
        self._speed = show.trace.states[:, 3]
        self._colours = np.array([to_rgb(limit_colour(limit)) for limit in limits])[None]
        end = float(self._time[-1])
        ax = figure.add_axes((0.075, 0.165, 0.905, 0.125))
        ax.plot(self._time, self._speed, color="#DDDDDD", linewidth=1.2)
        self._line = ax.plot([], [], color=arm_colour(show.arm), linewidth=1.8)[0]
        ax.set_xlim(0, end)
        ax.set_ylim(min(0.0, 1.2 * float(self._speed.min())), 1.05 * show.v_max)
        ax.set_ylabel("speed [m/s]", fontsize=8)
        ax.tick_params(labelsize=8, labelbottom=False, length=2)
        strip = figure.add_axes((0.075, 0.115, 0.905, 0.035))
        white = np.ones_like(self._colours)
        self._strip = strip.imshow(white, aspect="auto", extent=(0, end, 0, 1))
        strip.set_yticks([])
        strip.tick_params(labelsize=8, length=2)
        strip.set_xlabel("time [s]", fontsize=8, labelpad=1)
        for axes in (ax, strip):
            axes.spines[["top", "right"]].set_visible(False)
        patches, place = limit_patches(limits), (0.99, -0.01)
        figure.legend(
            handles=patches, loc="lower right", ncols=len(patches), bbox_to_anchor=place, **LEGEND
        )

    def update(self, tick: int) -> None:
        self._line.set_data(self._time[: tick + 1], self._speed[: tick + 1])
        driven = np.arange(self._colours.shape[1])[:, None] <= tick
        self._strip.set_data(np.where(driven, self._colours, 1.0))
