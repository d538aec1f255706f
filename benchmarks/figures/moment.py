"""Figure moment.png: observed map, prediction, risk map and plan at one tick of a drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from benchmarks.figures.palette import (
    DASHED,
    FREE_COLOUR,
    LEGEND,
    OCCUPIED_COLOUR,
    RELIED_COLOUR,
    SPEED_COLOURS,
    UNKNOWN_COLOUR,
    draw_body,
    draw_image,
    draw_speed,
    extent,
    map_image,
    note,
    outline,
    scale_bar,
    swatch,
)
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RecordedMoment, Trace
from foresee.infra.drawing import INK, bare, new_figure, short_name
from foresee.mapping.body import Body
from foresee.mapping.polyline import arc_length

BELIEVED_FREE, BELIEVED_OCCUPIED = "#A6CEE3", "#B2182B"
SEEN_SAFE = "#D6ECD2"
TRUTH_COLOUR = "#6A51A3"
"""Colour of the outline of the true free space."""
PATH: dict[str, Any] = {"color": INK, "linewidth": 1.2, "linestyle": DASHED}
STOPPED: dict[str, Any] = {
    "color": SPEED_COLOURS(0.0),
    "marker": "o",
    "markersize": 6,
    "linestyle": "none",
}


def moment(run: Run, index: int | None = None, arm: str | None = None) -> Figure:
    """Draw one tick of a drive in six panels; five show the outline of the true free space.

    The tick is the one that the drive has recorded as its moment.

    Args:
        run: run that contains the drive.
        index: number of the episode; None: of those whose moment relies on cells that are truly
            free, if any does, the one that relies on most.
        arm: arm that drove; None: `predicted`, else another arm that used a prediction, else any.

    Raises:
        RunError: if there is no such drive, or no moment of it was recorded.
    """
    arm = run.pick_arm(index, arm)
    if index is None:
        driven = [i for i in run.indices if (i, arm) in run.drives]
        index = max(driven, key=lambda i: _worth_showing(run.trace(i, arm)))
    trace = run.trace(index, arm)
    now, truth = trace.moment, trace.truth
    # Laid out by hand, to get six squares of equal size with room for a legend below each.
    figure = new_figure(12.6, 9.0, layout=None)
    figure.subplots_adjust(0.015, 0.085, 0.985, 0.905, wspace=0.14, hspace=0.2)
    axes, v_max = figure.subplots(2, 3), run.setting("v_max")
    _observed(axes[0, 0], now, run.setting("window"))
    _predicted(axes[0, 1], now)
    _trust(figure, axes[0, 2], now)
    if now.prediction is None:
        for ax in axes[0, 1:]:
            draw_image(ax, map_image(now.known.cells), now.known.frame)
            style: dict[str, Any] = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8}
            text = f"{arm} drives without a prediction"
            note(ax, text, (0.5, 0.5), fontsize=10, zorder=9, bbox=box, **style)
    _safe(axes[1, 0], now)
    _planned(axes[1, 1], now, v_max)
    _stop(axes[1, 2], now, run.body, v_max)
    view = _view(now)
    for ax in axes.flat[:5]:
        outline(ax, truth, TRUTH_COLOUR, 0.7, zorder=3)
        draw_body(ax, now.plan[0, :3], run.body, arm)
        ax.axis(view)
        bare(ax)
    scale_bar(axes[0, 0], 2.0)
    time = now.tick * run.setting("dt")
    figure.suptitle(
        f"{arm} · episode {index} · {short_name(run.drives[index, arm].world)} · {time:.1f} s into "
        f"the drive, at {now.plan[0, 3]:.2f} m/s",
        fontsize=12,
        color=INK,
        x=0.015,
        y=0.98,
        ha="left",
    )
    return figure


def _worth_showing(trace: Trace) -> tuple[bool, int]:
    """Return whether the cells that the moment relies on are truly free, and their number."""
    cells = trace.relied[int(trace.read("moment_tick"))].astype(int)
    # A plan may lead out of the building's map, where nothing is known to be free.
    inside = ((cells >= 0) & (cells < trace.truth.frame.shape)).all(axis=1)
    free = inside.all() and trace.truth.free[tuple(cells.T)].all()
    return bool(free), len(cells)


def _view(now: RecordedMoment) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top [m] of a square that contains all maps of this tick."""
    boxes = np.array([extent(now.known.frame), extent(now.frame)])
    left, right = boxes[:, 0].min(), boxes[:, 1].max()
    bottom, top = boxes[:, 2].min(), boxes[:, 3].max()
    half = max(right - left, top - bottom) / 2
    x, y = (left + right) / 2, (bottom + top) / 2
    return x - half, x + half, y - half, y + half


def _name(ax: Axes, title: str, handles: list[Artist], x: float = 0.5, y: float = -0.005) -> None:
    """Set the title of a panel, and draw its legend below it."""
    ax.set_title(title, loc="left", fontsize=11, color=INK)
    ax.set_facecolor(UNKNOWN_COLOUR)
    place: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (x, y)}
    ax.legend(handles=handles, ncols=len(handles), **place, **LEGEND)


def _truth() -> Line2D:
    return Line2D([], [], color=TRUTH_COLOUR, linewidth=1.0, label="truth")


def _observed(ax: Axes, now: RecordedMoment, window: float) -> None:
    draw_image(ax, map_image(now.known.cells), now.known.frame)
    handles: list[Artist] = [
        swatch(FREE_COLOUR, "free"),
        swatch(OCCUPIED_COLOUR, "occupied"),
        swatch(UNKNOWN_COLOUR, "not observed"),
    ]
    if window < max(now.known.frame.size):
        square = now.known.frame.square(float(now.plan[0, 0]), float(now.plan[0, 1]), window)
        style: dict[str, Any] = {"edgecolor": INK, "linewidth": 1.2, "linestyle": DASHED}
        ax.add_patch(Rectangle(square.origin, *square.size, fill=False, zorder=4, **style))
        handles.append(Line2D([], [], label="window", **PATH))
    _name(ax, "Observed map", [*handles, _truth()])


def _predicted(ax: Axes, now: RecordedMoment) -> None:
    colours = {
        "likely free": BELIEVED_FREE,
        "likely occupied": BELIEVED_OCCUPIED,
        "no prediction": UNKNOWN_COLOUR,
    }
    handles = [swatch(colour, label) for label, colour in colours.items()]
    _name(ax, "Predicted map", [*handles, _truth()])
    if now.prediction is None:
        return
    known = now.known.crop(now.frame)
    image = map_image(known.cells)
    free, occupied, _ = now.prediction
    shares = (free, occupied, np.clip(1.0 - free - occupied, 0.0, 1.0))
    blend = sum(
        share[..., None] * np.array(to_rgb(colour))
        for share, colour in zip(shares, colours.values(), strict=True)
    )
    image[known.unknown] = np.clip(blend, 0.0, 1.0)[known.unknown]
    draw_image(ax, image, now.frame)


def _trust(figure: Figure, ax: Axes, now: RecordedMoment) -> None:
    predicted = now.prediction is not None
    _name(ax, "Trust that cells are free", [_truth()], x=0.12 if predicted else 0.5)
    if now.prediction is None:
        return
    free, _, confidence = now.prediction
    trust = ax.imshow(confidence * free, "cividis", vmin=0, vmax=1, extent=extent(now.frame))
    # The colour bar takes the place of a legend, so that all panels keep the same size.
    place = ax.inset_axes((0.28, -0.05, 0.42, 0.025))
    bar = figure.colorbar(trust, cax=place, ticks=[0, 0.5, 1], orientation="horizontal")
    bar.ax.tick_params(labelsize=8, length=2, pad=1)
    bar.ax.annotate("trust", (1.03, 0.5), xycoords="axes fraction", va="center", fontsize=8)
    bar.outline.set_visible(False)


def _safe_image(now: RecordedMoment) -> NDArray[np.float64]:
    image = map_image(now.known.cells)
    image[now.safe & now.known.free] = to_rgb(SEEN_SAFE)
    image[now.safe & ~now.known.free] = to_rgb(RELIED_COLOUR)
    return image


def _safe(ax: Axes, now: RecordedMoment) -> None:
    draw_image(ax, _safe_image(now), now.known.frame)
    handles = [
        swatch(SEEN_SAFE, "observed free"),
        swatch(RELIED_COLOUR, "predicted free"),
        swatch(UNKNOWN_COLOUR, "other"),
    ]
    _name(ax, "Cells that the plan may enter", [*handles, _truth()])


def _planned(ax: Axes, now: RecordedMoment, v_max: float) -> None:
    # Paler, so that the lines stand out.
    draw_image(ax, 0.55 * _safe_image(now) + 0.45, now.known.frame)
    ax.plot(*now.path.T, zorder=3.5, **PATH)
    draw_speed(ax, now.plan[:, :2], now.plan[:, 3], v_max, width=3.0)
    ax.plot(*now.plan[-1, :2], zorder=6, markeredgecolor="white", **STOPPED)
    handles = [
        Line2D([], [], label="path", **PATH),
        Line2D([], [], color=SPEED_COLOURS(0.5), linewidth=3, label="plan"),
        Line2D([], [], label="stopped", **STOPPED),
    ]
    _name(ax, "Path, and plan that ends stopped", [*handles, _truth()])
    ax.set_facecolor("#EAEAEA")


def _stop(ax: Axes, now: RecordedMoment, body: Body, v_max: float) -> None:
    """Draw the speed along the plan, and whether the car's front is then on observed cells."""
    x, y, yaw, speed = now.plan.T
    distance = arc_length(now.plan)
    reverse = bool(speed.min() < 0)
    ahead = -body.half_length if reverse else body.half_length
    ends = np.column_stack([x + ahead * np.cos(yaw), y + ahead * np.sin(yaw)])
    seen, rows, cols = now.known.frame.locate(ends)
    seen[seen] = now.known.free[rows, cols]
    for k, colour in enumerate(np.where(seen[1:], SEEN_SAFE, RELIED_COLOUR)):
        ax.axvspan(distance[k], distance[k + 1], color=str(colour), linewidth=0)
    speed = np.abs(speed)
    draw_speed(ax, np.column_stack([distance, speed]), speed, v_max, width=3.0)
    ax.set(
        xlim=(0, max(distance[-1] * 1.02, 0.1)),
        ylim=(0, 1.05 * v_max),
        xlabel="distance driven in reverse [m]" if reverse else "distance ahead [m]",
        ylabel="planned speed [m/s]",
        box_aspect=1,
    )
    handles: list[Artist] = [
        swatch(SEEN_SAFE, f"{'rear' if reverse else 'front'} on observed cells"),
        swatch(RELIED_COLOUR, "on predicted cells"),
    ]
    _name(ax, "Speed along the plan", handles, y=-0.11)
    ax.set_facecolor("white")
    ax.spines[["top", "right"]].set_visible(False)
