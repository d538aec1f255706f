"""One tick in full: what is seen, what is believed, what is relied upon, and the plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from benchmarks.figures.palette import (
    FREE_COLOUR,
    INK,
    OCCUPIED_COLOUR,
    RELIED_COLOUR,
    SPEED_COLOURS,
    UNKNOWN_COLOUR,
    arm_colour,
    bare,
    draw_body,
    draw_image,
    extent,
    map_image,
    new_figure,
    scale_bar,
    speed_line,
)
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import frame_of
from predictor.mapping.body import Body
from predictor.mapping.conventions import TICK
from predictor.mapping.grid import Grid, GridFrame, paste

BELIEVED_FREE, BELIEVED_OCCUPIED = "#A6CEE3", "#B2182B"
SEEN_SAFE = "#D6ECD2"
TRUTH_COLOUR = "#6A51A3"
"""The outline of the true free space."""


@dataclass(frozen=True, eq=False)
class _Moment:
    """A tick, as the trace holds it."""

    arm: str
    tick: int
    known: Grid
    safe: NDArray[np.bool_]
    plan: NDArray[np.float64]
    path: NDArray[np.float64]
    prediction: dict[str, NDArray[np.float64]] | None
    frame: GridFrame
    truth: Grid


def moment(run: Run, index: int | None = None, arm: str | None = None) -> Figure:
    """Draw one tick in six panels, each with the outline of the true free space.

    Args:
        run: whose drives.
        index: which episode; by default the one that relied most on what it had not seen.
        arm: whose; by default `predicted`, else one that had a prediction, else any.

    Raises:
        RunError: if there is no such drive, or no moment of it was kept.
    """
    arm, index = _choose(run, index, arm)
    now = _load(run, index, arm)
    figure = new_figure(12.6, 9.0)
    # Placed by hand: six squares of one size, with room for a legend below each.
    figure.set_layout_engine("none")
    axes = figure.subplots(
        2,
        3,
        gridspec_kw={
            "left": 0.015,
            "right": 0.985,
            "bottom": 0.085,
            "top": 0.905,
            "hspace": 0.2,
            "wspace": 0.14,
        },
    )
    body, v_max = Body(), run.setting("v_max", 4.0)
    colour = arm_colour(arm)
    _seen(axes[0, 0], now, run.setting("window", 5.0))
    _believed(axes[0, 1], now)
    _trust(figure, axes[0, 2], now)
    _safe(axes[1, 0], now)
    _planned(axes[1, 1], now, v_max)
    _stop(axes[1, 2], now, v_max)
    box = _view(now)
    for ax in axes.flat[:5]:
        _outline(ax, now.truth)
        draw_body(ax, now.plan[0, :3], body, colour)
        ax.set_xlim(box[0], box[1])
        ax.set_ylim(box[2], box[3])
        bare(ax)
    scale_bar(axes[0, 0], 2.0)
    dt = run.setting("dt", TICK)
    figure.suptitle(
        f"{arm} · episode {index} · {run.drives[index, arm].world} · {now.tick * dt:.1f} s into "
        f"the drive, at {now.plan[0, 3]:.2f} m/s",
        fontsize=12,
        color=INK,
        x=0.015,
        y=0.98,
        ha="left",
    )
    return figure


def _choose(run: Run, index: int | None, arm: str | None) -> tuple[str, int]:
    arm = run.pick_arm(index, arm)
    if index is None:
        driven = [i for i in run.indices if (i, arm) in run.drives]
        index = max(driven, key=lambda i: int(run.trace(i, arm)["relied_count"].max(initial=0)))
    return arm, index


def _load(run: Run, index: int, arm: str) -> _Moment:
    trace, truth = run.trace(index, arm), run.truth(index)
    known = trace["moment_known"]
    frame = frame_of(run.archive.path, trace["moment_frame"], known)
    prediction, other = None, frame
    if "moment_p_free" in trace:
        names = ("p_free", "p_occupied", "confidence")
        prediction = {name: trace[f"moment_{name}"] / 255.0 for name in names}
        numbers = trace["moment_prediction_frame"]
        other = frame_of(run.archive.path, numbers, prediction["p_free"])
    return _Moment(
        arm,
        int(trace["moment_tick"]),
        Grid(frame, known),
        trace["moment_safe"].astype(bool),
        trace["moment_plan"].astype(np.float64),
        trace["moment_path"].astype(np.float64),
        prediction,
        other,
        truth,
    )


def _view(now: _Moment) -> tuple[float, float, float, float]:
    """Return left, right, bottom, top of a square that holds the maps of this tick."""
    boxes = np.array([extent(now.known.frame), extent(now.frame)])
    left, right = boxes[:, 0].min(), boxes[:, 1].max()
    bottom, top = boxes[:, 2].min(), boxes[:, 3].max()
    half = max(right - left, top - bottom) / 2
    x, y = (left + right) / 2, (bottom + top) / 2
    return x - half, x + half, y - half, y + half


def _name(ax: Axes, title: str, handles: list[Patch | Line2D]) -> None:
    ax.set_title(title, loc="left", fontsize=11, color=INK)
    ax.set_facecolor(UNKNOWN_COLOUR)
    ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.005),
        frameon=False,
        ncols=len(handles),
        fontsize=8,
        handlelength=1.2,
        columnspacing=1.0,
    )


def _patch(colour: str, label: str) -> Patch:
    return Patch(facecolor=colour, edgecolor="#888888", linewidth=0.5, label=label)


def _truth_line() -> Line2D:
    return Line2D([], [], color=TRUTH_COLOUR, linewidth=1.0, label="truth")


def _outline(ax: Axes, truth: Grid) -> None:
    x, y = truth.frame.centres()
    ax.contour(
        x, y, truth.free.astype(float), [0.5], colors=[TRUTH_COLOUR], linewidths=0.7, zorder=3
    )


def _seen(ax: Axes, now: _Moment, window: float) -> None:
    draw_image(ax, map_image(now.known.cells), now.known.frame)
    handles: list[Patch | Line2D] = [
        _patch(FREE_COLOUR, "free"),
        _patch(OCCUPIED_COLOUR, "occupied"),
        _patch(UNKNOWN_COLOUR, "not seen"),
    ]
    if window < max(now.known.frame.size):
        square = now.known.frame.square(float(now.plan[0, 0]), float(now.plan[0, 1]), window)
        left, right, bottom, top = extent(square)
        style: dict[str, Any] = {"linewidth": 1.2, "linestyle": (0, (4, 2))}
        ax.add_patch(
            Rectangle(
                (left, bottom),
                right - left,
                top - bottom,
                fill=False,
                edgecolor=INK,
                zorder=4,
                **style,
            )
        )
        handles.append(Line2D([], [], color=INK, label="window", **style))
    _name(ax, "What has been seen", [*handles, _truth_line()])


def _missing(ax: Axes, now: _Moment) -> None:
    draw_image(ax, map_image(now.known.cells), now.known.frame)
    ax.annotate(
        f"{now.arm} drives without a prediction",
        (0.5, 0.5),
        xycoords="axes fraction",
        ha="center",
        va="center",
        fontsize=10,
        color=INK,
        zorder=9,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )


def _believed(ax: Axes, now: _Moment) -> None:
    _name(
        ax,
        "What is believed beyond it",
        [
            _patch(BELIEVED_FREE, "likely free"),
            _patch(BELIEVED_OCCUPIED, "likely occupied"),
            _patch(UNKNOWN_COLOUR, "no belief"),
            _truth_line(),
        ],
    )
    if now.prediction is None:
        return _missing(ax, now)
    known = paste(now.known.frame, now.known.cells, now.frame, np.int8(-1))
    image = map_image(known)
    free, occupied = now.prediction["p_free"], now.prediction["p_occupied"]
    rest = np.clip(1.0 - free - occupied, 0.0, 1.0)
    blend = (
        free[..., None] * np.array(to_rgb(BELIEVED_FREE))
        + occupied[..., None] * np.array(to_rgb(BELIEVED_OCCUPIED))
        + rest[..., None] * np.array(to_rgb(UNKNOWN_COLOUR))
    )
    unseen = known == -1
    image[unseen] = np.clip(blend, 0.0, 1.0)[unseen]
    draw_image(ax, image, now.frame)


def _trust(figure: Figure, ax: Axes, now: _Moment) -> None:
    _name(ax, "How far it is trusted to be free", [_truth_line()])
    if now.prediction is None:
        return _missing(ax, now)
    ax.get_legend().set_bbox_to_anchor((0.12, -0.005))  # type: ignore[union-attr]
    trust = now.prediction["confidence"] * now.prediction["p_free"]
    image = ax.imshow(
        trust,
        origin="lower",
        extent=extent(now.frame),
        interpolation="nearest",
        cmap="cividis",
        vmin=0,
        vmax=1,
    )
    # Where the other panels have their legends, so that all panels stay of one size.
    bar = figure.colorbar(
        image,
        cax=ax.inset_axes((0.28, -0.05, 0.42, 0.025)),
        ticks=[0, 0.5, 1],
        orientation="horizontal",
    )
    bar.ax.tick_params(labelsize=8, length=2, pad=1)
    bar.ax.annotate(
        "confidence · p_free", (1.03, 0.5), xycoords="axes fraction", va="center", fontsize=8
    )
    bar.outline.set_visible(False)


def _safe_image(now: _Moment) -> NDArray[np.float64]:
    image = map_image(now.known.cells)
    image[now.known.free] = to_rgb(FREE_COLOUR)
    image[now.safe & now.known.free] = to_rgb(SEEN_SAFE)
    image[now.safe & ~now.known.free] = to_rgb(RELIED_COLOUR)
    return image


def _safe(ax: Axes, now: _Moment) -> None:
    draw_image(ax, _safe_image(now), now.known.frame)
    _name(
        ax,
        "What the plan may rely upon",
        [
            _patch(SEEN_SAFE, "seen free"),
            _patch(RELIED_COLOUR, "only believed free"),
            _patch(UNKNOWN_COLOUR, "neither"),
            _truth_line(),
        ],
    )


def _planned(ax: Axes, now: _Moment, v_max: float) -> None:
    image = _safe_image(now)
    # Paler, so that the lines stand out.
    draw_image(ax, 0.55 * image + 0.45, now.known.frame)
    if len(now.path):
        ax.plot(*now.path[:, :2].T, color=INK, linewidth=1.2, linestyle=(0, (4, 2)), zorder=3.5)
    speed_line(ax, now.plan[:, :2], now.plan[:, 3], v_max, width=3.0)
    ax.plot(
        *now.plan[-1, :2],
        "o",
        color=SPEED_COLOURS(0.0),
        markersize=6,
        zorder=6,
        markeredgecolor="white",
    )
    _name(
        ax,
        "The path, and the plan to a stop",
        [
            Line2D([], [], color=INK, linestyle=(0, (4, 2)), linewidth=1.2, label="path"),
            Line2D([], [], color=SPEED_COLOURS(0.5), linewidth=3, label="plan"),
            Line2D(
                [],
                [],
                color=SPEED_COLOURS(0.0),
                marker="o",
                markersize=6,
                linestyle="none",
                label="stopped",
            ),
            _truth_line(),
        ],
    )
    ax.set_facecolor("#EAEAEA")


def _stop(ax: Axes, now: _Moment, v_max: float) -> None:
    """Draw the speed along the plan, over what the leading end of the car stands on."""
    plan = now.plan
    steps = np.hypot(*np.diff(plan[:, :2], axis=0).T)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    reverse = bool(plan[:, 3].min() < 0)
    ahead = -Body().half_length if reverse else Body().half_length
    for k in range(len(steps)):
        x = plan[k + 1, 0] + ahead * np.cos(plan[k + 1, 2])
        y = plan[k + 1, 1] + ahead * np.sin(plan[k + 1, 2])
        row, col = now.known.frame.cell(float(x), float(y))
        rows, cols = now.known.frame.shape
        seen = 0 <= row < rows and 0 <= col < cols and bool(now.known.free[row, col])
        ax.axvspan(
            distance[k], distance[k + 1], color=SEEN_SAFE if seen else RELIED_COLOUR, linewidth=0
        )
    speed = np.abs(plan[:, 3])
    speed_line(ax, np.column_stack([distance, speed]), speed, v_max, width=3.0)
    ax.set_xlim(0, max(distance[-1] * 1.02, 0.1))
    ax.set_ylim(0, 1.05 * v_max)
    ax.set_xlabel("distance driven in reverse [m]" if reverse else "distance ahead [m]")
    ax.set_ylabel("planned speed [m/s]")
    ax.set_box_aspect(1)
    _name(
        ax,
        "Where the plan comes to a stop",
        [
            _patch(SEEN_SAFE, f"{'rear' if reverse else 'front'} on seen ground"),
            _patch(RELIED_COLOUR, "on believed ground"),
        ],
    )
    ax.get_legend().set_bbox_to_anchor((0.5, -0.11))  # type: ignore[union-attr]
    ax.set_facecolor("white")
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
