"""The figure of the study: the worth of prediction over what the car can see."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.figures.palette import arm_colour
from benchmarks.studies.worth.series import WINDOWS
from foresee.infra.drawing import INK, new_figure, save_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = "osD^v"
"""Markers of the top speeds, in order."""


def draw(results: dict[str, Any], out: Path) -> list[Path]:
    """Draw the figure if the results suffice for it, and return its file."""
    rows = [row for row in results["rows"] if row["part"] == WINDOWS and row["time_over_baseline"]]
    return save_figures([("worth.png", lambda: _worth(rows))], out) if rows else []


def _worth(rows: list[dict[str, Any]]) -> Figure:
    """Draw the time over that of the best baseline, over stopping distance / distance of sight."""
    figure = new_figure(6.4, 4.2)
    axes = figure.subplots()
    axes.axhline(1.0, color=INK, linewidth=0.8)
    axes.axvline(1.0, color=INK, linewidth=0.8, linestyle=":")
    markers = dict(zip(sorted({row["v_max"] for row in rows}), cycle(MARKERS), strict=False))
    drivers = list(dict.fromkeys(row["driver"] for row in rows))
    for place, driver in enumerate(drivers):
        # Side by side, so that intervals do not hide each other.
        shift = 1.0 + 0.02 * (place - 0.5 * (len(drivers) - 1))
        of = [row for row in rows if row["driver"] == driver]
        colour = _colour(of[0])
        axes.plot([], [], color=colour, linewidth=0.8, label=driver)
        for v_max, marker in markers.items():
            points = sorted(
                (row for row in of if row["v_max"] == v_max), key=lambda r: r["stop_over_sight"]
            )
            xs = [shift * row["stop_over_sight"] for row in points]
            values = [row["time_over_baseline"]["value"] for row in points]
            axes.plot(xs, values, color=colour, linewidth=0.8)
            for x, row in zip(xs, points, strict=True):
                ratio, certified = row["time_over_baseline"], row["certified"] or not row["risk"]
                if ratio["low"] is not None:
                    axes.plot([x, x], [ratio["low"], ratio["high"]], color=colour, linewidth=1.2)
                filling = colour if certified else "white"
                axes.plot(
                    x, ratio["value"], marker, color=colour, markersize=5, markerfacecolor=filling
                )
    for v_max, marker in markers.items():
        axes.plot([], [], marker, color=INK, label=f"{v_max:g} m/s")
    if any(row["risk"] and not row["certified"] for row in rows):
        axes.plot([], [], "o", color=INK, markerfacecolor="white", label="not certified")
    axes.set(
        xscale="log",
        xlabel="stopping distance from top speed / distance of sight",
        ylabel="time over that of the best baseline\nwithout a network, at the same risk",
    )
    ticks = sorted({round(row["stop_over_sight"], 2) for row in rows})
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.legend(fontsize=8)
    return figure


def _colour(row: dict[str, Any]) -> str:
    """Return the colour of a driver: that of its arm at its risk, or of no arm for a rival."""
    if row["arm"] != "predicted":
        return arm_colour(row["arm"])
    kind = "predicted" if row["predictor"] == "compact" else row["predictor"]
    return arm_colour(f"{kind} {100 * row['risk']:g} %" if row["risk"] else kind)
