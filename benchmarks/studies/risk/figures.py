"""The figures of the study: requested against realised risk, and speed against collisions."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.figures.palette import arm_colour
from benchmarks.studies.risk.series import MIXTURE, OWN, PROMISE
from foresee.infra.drawing import INK, new_figure, save_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MANY = 40
"""Number of drives from which on an interval decides how far the axis reaches."""


def draw(results: dict[str, Any], out: Path) -> list[Path]:
    """Draw the figures that the results suffice for, and return their files."""
    figures = [
        ("promise.png", partial(_promise, results)),
        ("pareto.png", partial(_pareto, results)),
    ]
    return save_figures(figures, out)


def _promise(results: dict[str, Any]) -> Figure | None:
    """Draw the realised risk of the mixture, of other buildings and of all controls beside the
    requested one."""
    rows = [r for r in results["promise"] if r["requested"]]
    if not rows:
        return None
    kinds = list(dict.fromkeys(map(_kind, rows)))
    risks = sorted({r["requested"] for r in rows})
    columns = min(3, len(risks))
    lines = math.ceil(len(risks) / columns)
    size = 2.6 + 3.0 * columns, (1.0 + 0.28 * len(kinds)) * lines
    figure = new_figure(*size)
    panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, risk in zip(panels, risks, strict=False):
        axes.axvline(100 * risk, color=INK, linewidth=0.8, linestyle="--")
        for row in (r for r in rows if r["requested"] == risk):
            place = len(kinds) - 1 - kinds.index(_kind(row))
            axes.errorbar(
                100 * row["rate"],
                place,
                xerr=_around(row["rate"], row["interval"]),
                color=arm_colour("predicted") if row["group"] in (PROMISE, OWN) else INK,
                marker="o",
                markersize=4,
                linewidth=1.0,
            )
            axes.annotate(
                f"{row['collided']} of {row['drives']}",
                (1.0, place),
                (-4, 5),
                xycoords=axes.get_yaxis_transform(),
                textcoords="offset points",
                ha="right",
                fontsize=7,
            )
        axes.set_title(f"requested: {100 * risk:g} %", fontsize=9)
        axes.set_xlabel("collisions [% of drives]")
        axes.tick_params(labelbottom=True)
    for axes in panels[len(risks) :]:
        axes.set_axis_off()
    # Intervals from a few drives may be cut off: they would make the others too short to read.
    drawn = [(row, row["interval"] if row["drives"] >= MANY else None) for row in rows]
    ends = [interval[1] if interval else row["rate"] for row, interval in drawn]
    panels[0].set(xlim=(-1, 100 * max(ends) + 2), ylim=(-0.5, len(kinds) - 0.3))
    names = [place if group == PROMISE else f"{place}, {group}" for group, place in kinds]
    for axes in panels[::columns]:
        axes.set_yticks(range(len(kinds)), reversed(names), fontsize=8)
    return figure


def _kind(row: dict[str, Any]) -> tuple[str, str]:
    return row["group"], row["tasks"]


def _pareto(results: dict[str, Any]) -> Figure | None:
    """Draw SCT over the rate of collisions in the buildings of the calibration."""
    rates = {(r["group"], r["series"]): r["rate"] for r in results["promise"]}
    points = [r for r in results["pareto"] if _kind(r) == (PROMISE, MIXTURE) and r["sct"]]
    if not points:
        return None
    figure = new_figure(5.0, 3.6)
    axes = figure.subplots()
    for arm in dict.fromkeys(r["arm"] for r in points):
        here = sorted((r for r in points if r["arm"] == arm), key=lambda r: r["level"])
        axes.plot(
            [100 * rates[r["group"], r["series"]] for r in here],
            [r["sct"]["value"] for r in here],
            color=arm_colour(arm),
            marker="o",
            markersize=4,
            linewidth=0.8,
            label=arm,
        )
    end = max(10.0, 1.1 * axes.dataLim.x1)
    axes.set(xlabel="collisions [% of drives]", xlim=(-0.03 * end, end), ylabel="SCT", ylim=(0, 1))
    axes.legend(fontsize=7)
    return figure


def _around(rate: float, interval: list[float] | None) -> list[list[float]]:
    """Return an error bar [%], of no length without an interval."""
    low, high = interval or (rate, rate)
    return [[100 * max(0.0, rate - low)], [100 * max(0.0, high - rate)]]
