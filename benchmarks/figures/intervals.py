"""Figures of a report: the main measures of each arm with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.figures.palette import arm_colour
from foresee.infra.drawing import INK, new_figure

Summary = dict[str, Any]
"""Arm → measures, see `benchmarks.runs.summary.summarise`."""
POINT: dict[str, Any] = {
    "marker": "o",
    "markersize": 5.5,
    "markeredgecolor": "white",
    "elinewidth": 2,
}


class _Estimate(NamedTuple):
    """A value, and both ends of its interval; None: there is none."""

    value: float
    ends: Sequence[float] | None

    @classmethod
    def of(cls, entry: dict[str, Any], name: str) -> _Estimate | None:
        """Return a measure of an arm; None if it is not known."""
        value = entry[name]
        return None if value is None else cls(value, entry[f"{name}_interval"])

    @property
    def bars(self) -> list[list[float]] | None:
        """Lengths of the bars to both sides of the value."""
        if self.ends is None:
            return None
        low, high = self.ends
        return [[self.value - low], [high - self.value]]


def forest(summary: Summary) -> Figure:
    """Draw a forest plot: time ratio, SCT and speed of each arm, with 95 % intervals."""
    arms = list(summary)
    figure = new_figure(10.0, 0.9 + 0.36 * len(arms))
    left, middle, right = figure.subplots(1, 3, sharey=True)
    _column(left, "time ratio to known", [_time_ratio(entry) for entry in summary.values()], arms)
    left.axvline(1.0, color=INK, linewidth=0.8)
    for ax, name, key in ((middle, "SCT", "sct"), (right, "speed [m/s]", "mean_speed")):
        _column(ax, name, [_Estimate.of(entry, key) for entry in summary.values()], arms)
    left.set_yticks(range(len(arms)), arms)
    left.set_ylim(len(arms) - 0.4, -0.6)
    return figure


def speed_and_collisions(summary: Summary) -> Figure:
    """Draw the share of drives that collided over the speed of each arm, with 95 % intervals."""
    figure = new_figure(7.0, 3.2)
    ax = figure.subplots()
    for arm, entry in summary.items():
        speed = _Estimate(entry["mean_speed"], entry["mean_speed_interval"])
        ends = entry["collided_interval"]
        share = 100.0 * entry["collided"] / entry["episodes"]
        collided = _Estimate(share, ends and [100.0 * end for end in ends])
        style = {"color": arm_colour(arm), **POINT}
        ax.errorbar(speed.value, share, xerr=speed.bars, yerr=collided.bars, label=arm, **style)
    ax.set(xlabel="speed [m/s]", ylabel="drives that collided [%]")
    # A percent at least, so that no collision is at the bottom, and a single one is not at the top.
    top = max(1.1 * ax.get_ylim()[1], 1.0)
    ax.set_ylim(-0.05 * top, top)
    # Beside the plot, since arms may lie on each other.
    figure.legend(loc="outside right upper", fontsize=9)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _column(ax: Axes, name: str, values: list[_Estimate | None], arms: list[str]) -> None:
    for row, (arm, estimate) in enumerate(zip(arms, values, strict=True)):
        if estimate is not None:
            style = {"color": arm_colour(arm), **POINT}
            ax.errorbar(estimate.value, row, xerr=estimate.bars, **style)
    ax.set_title(name, loc="left", fontsize=10, color=INK)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="x", color="#E5E5E5", linewidth=0.8)
    ax.set_axisbelow(True)
    ax.spines[["top", "right", "left"]].set_visible(False)


def _time_ratio(entry: dict[str, Any]) -> _Estimate | None:
    ratio = entry.get("time_ratio")
    if ratio is None:
        return None
    ends = None if ratio["low"] is None else (ratio["low"], ratio["high"])
    return _Estimate(ratio["value"], ends)
