"""The figures of the study: requested against realised risk, and speed against collisions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.figures.palette import ARM_COLOURS, INK, OTHER_ARM

GROUPS = {"promise": "o", "uncalibrated": "s", "not adapted": "^", "sham": "X"}
"""Groups with a requested risk, and their markers."""


def draw(found: dict[str, Any], out: Path) -> list[Path]:
    """Draw the figures that the results suffice for, and return their files."""
    paths = []
    for name, figure in (("promise", _promise(found)), ("pareto", _pareto(found))):
        if figure is not None:
            figure.savefig(path := out / f"{name}.png", dpi=150)
            paths.append(path)
    return paths


def _promise(found: dict[str, Any]) -> Figure | None:
    """Draw the realised risk over the requested one, for the mixture and all controls."""
    rows = [r for r in found["promise"] if r["requested"] and r["group"] in GROUPS]
    if not rows:
        return None
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.subplots()
    most = max(r["interval"][1] for r in rows)
    edge = max(most, max(r["requested"] for r in rows)) * 1.1
    axes.plot([0, edge], [0, edge], color=INK, linewidth=0.8, label="as requested")
    kinds = sorted({_kind(r) for r in rows})
    for number, (group, place) in enumerate(kinds):
        mine = sorted((r for r in rows if _kind(r) == (group, place)), key=lambda r: r["requested"])
        # Side by side, so that the intervals can be told apart.
        shift = edge * 0.004 * (number - len(kinds) / 2)
        rates = [r["rate"] for r in mine]
        axes.errorbar(
            [r["requested"] + shift for r in mine],
            rates,
            [
                [max(0.0, r["rate"] - r["interval"][0]) for r in mine],
                [max(0.0, r["interval"][1] - r["rate"]) for r in mine],
            ],
            marker=GROUPS[group],
            linewidth=0.8,
            markersize=4,
            capsize=2,
            label=f"{place}" + ("" if group == "promise" else f", {group}"),
        )
    axes.set(
        xlabel="requested risk δ, collisions per drive",
        ylabel="realised risk (95 % intervals)",
        xlim=(0, None),
        ylim=(0, None),
    )
    axes.legend(fontsize=7, ncols=2)
    return figure


def _kind(row: dict[str, Any]) -> tuple[str, str]:
    return row["group"], row["tasks"]


def _pareto(found: dict[str, Any]) -> Figure | None:
    """Draw SCT over the rate of collisions of all arms, for each kind of tasks."""
    compared = dict.fromkeys(_kind(r) for r in found["pareto"])
    if not compared:
        return None
    columns = min(4, len(compared))
    rows = math.ceil(len(compared) / columns)
    figure = Figure(figsize=(3.2 * columns, 3.0 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, kind in zip(panels, compared, strict=False):
        here = [r for r in found["promise"] if _kind(r) == kind and r["sct"] is not None]
        for arm in dict.fromkeys(map(_arm, here)):
            mine = sorted((r for r in here if _arm(r) == arm), key=lambda r: r["level"])
            axes.errorbar(
                [100 * r["rate"] for r in mine],
                [r["sct"] for r in mine],
                xerr=[
                    [100 * max(0.0, r["rate"] - r["interval"][0]) for r in mine],
                    [100 * max(0.0, r["interval"][1] - r["rate"]) for r in mine],
                ],
                color=ARM_COLOURS.get(arm, OTHER_ARM),
                marker="o",
                markersize=4,
                linewidth=0.8,
                label=arm,
            )
        car = "{v_max:g} m/s, {braking:g} m/s², window {window:g} m".format(**here[0])
        place = " ".join(here[0]["world"]) if len(here[0]["world"]) == 1 else "mixture"
        axes.set_title(f"{place}\n{car}", fontsize=9)
        axes.set(xlabel="collisions [% of drives]", ylabel="SCT")
        axes.legend(fontsize=7)
    for axes in panels[len(compared) :]:
        axes.set_axis_off()
    return figure


def _arm(row: dict[str, Any]) -> str:
    """Return the name of a line: the arm, or `extend` for drives with that predictor."""
    return "extend" if row["predictor"] == "extend" else str(row["arm"])


def _car(row: dict[str, Any]) -> tuple[float, float, float]:
    return row["v_max"], row["braking"], row["window"]
