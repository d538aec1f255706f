"""Tables over several files of results, a line for each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.summary import broken, gap, summarise
from predictor.infra.markdown import DASH, figure, interval, markdown


def summarised(run: dict[str, Any]) -> dict[str, Any]:
    """Summarise a comparison's episodes again: old files have fewer figures."""
    episodes, arms = [*map(DriveResult.from_json, run["episodes"])], tuple(run["settings"]["arms"])
    route = run["settings"]["route"]
    return run | {"summary": summarise(episodes, arms), "gap": gap(episodes, arms, route)}


def overview(runs: dict[str, dict[str, Any]]) -> str:
    """Return a table of one line for each comparison: what prediction brought, and its price.

    A dash stands for an arm that did not drive, and for a figure that older results lack.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor`.
    """
    arms = ("known", "predicted", "oracle", "full")
    rows = [
        [
            " / ".join(f"`{arm}`" for arm in arms),
            "car",
            "episodes",
            "SCT",
            "time ratio `predicted` to `known`",
            "gap closed in SCT",
            "gap closed in time",
            "detour",
            "speed [m/s]",
            "reached",
            "stuck",
            "collided",
        ]
    ]
    for name, run in runs.items():
        summary = run["summary"]

        def each(key: str, form: str, of: dict[str, Any] = summary) -> str:
            values = [of[arm][key] if arm in of else None for arm in arms]
            return " / ".join(DASH if value is None else format(value, form) for value in values)

        known, ratio, shares = summary["known"], summary["predicted"]["time_ratio"], run["gap"]
        closed = [
            "" if shares[key] is None else interval(shares[key], ".0f", 100.0) + " %"
            for key in ("sct", "time")
        ]
        if "oracle" in summary and shares["sct"] is None and known["sct_interval"] is not None:
            closed[0] = "no gap"
        rows.append(
            [
                name,
                known["vehicle"],
                str(known["episodes"]),
                each("sct", ".3f"),
                "" if ratio is None else interval(ratio, ".2f"),
                *closed,
                each("detour", ".2f"),
                each("mean_speed", ".2f"),
                *(each(key, "d") for key in ("reached", "stuck", "collided")),
            ]
        )
    return markdown(rows)


def risks(runs: dict[str, dict[str, Any]]) -> str:
    """Return a line for each run of `predicted`: the risk asked for and the realised one.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor`, `summarised`.
    """
    rows = [
        [
            "run",
            "predictor",
            "expansion",
            "ε",
            "promises broken (95 % over worlds)",
            "episodes",
            "reached",
            "collided",
            "SCT",
            "speed [m/s]",
        ]
    ]
    for name, run in runs.items():
        settings, entry = run["settings"], run["summary"]["predicted"]
        rows.append(
            [
                name,
                f"`{Path(settings['predictor']).stem}`",
                f"{settings['expansion']:g}",
                f"{settings['risk']:g}",
                broken(entry),
                *(str(entry[key]) for key in ("episodes", "reached", "collided")),
                figure(entry["sct"], entry["sct_interval"], ".3f"),
                figure(entry["mean_speed"], entry["mean_speed_interval"], ".2f"),
            ]
        )
    return markdown(rows)


def scores(runs: dict[str, dict[str, Any]]) -> str:
    """Return a line for each predictor on each group of buildings: its scores.

    Args:
        runs: name → contents of a results.json of `predictor.evaluate`.
    """
    columns = ("iou_free", "iou_occupied", "auc_free", "brier_free", "nll", "ece_free", "ssim")
    rows = [["buildings", "predictor", *(name.replace("_", " ") for name in columns)]]
    for run in runs.values():
        for group, entry in run["groups"].items():
            for name, row in entry["predictors"].items():
                if "(" not in name:
                    found = [row.get(column) for column in columns]
                    cells = ["" if value is None else f"{value:.3f}" for value in found]
                    rows.append([group, f"`{name}`", *cells])
    return markdown(rows)
