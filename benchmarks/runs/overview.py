"""Tables over several results files, with one line or more for each file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import checked, up_to_date
from benchmarks.runs.summary import gap, summarise
from benchmarks.runs.summary_text import EARLIER, broken
from foresee.infra.markdown import DASH, figure, interval, records


def summarised(run: dict[str, Any]) -> dict[str, Any]:
    """Summarise the episodes of a comparison again, since older files lack some measures."""
    settings = checked(up_to_date(run["settings"]))
    episodes, arms = [*map(DriveResult.from_json, run["episodes"])], tuple(settings["arms"])
    route = settings["route"]
    return run | {"summary": summarise(episodes, arms), "gap": gap(episodes, arms, route)}


def overview(runs: dict[str, dict[str, Any]]) -> str:
    """Return a table of the main measures of several comparisons, one line for each.

    A dash stands for an arm that did not drive, and for a measure that older results lack.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor` with the arm `known`.
    """
    arms = list(dict.fromkeys(arm for run in runs.values() for arm in run["summary"]))
    ratios = [arm for arm in arms if arm != "known"]
    rows = []
    for name, run in runs.items():
        summary, settings = run["summary"], up_to_date(run["settings"])

        def each(key: str, form: str, of: dict[str, Any] = summary) -> str:
            values = [of[arm][key] if arm in of else None for arm in arms]
            return " / ".join(DASH if value is None else format(value, form) for value in values)

        known = summary["known"]
        earlier = any(summary[arm]["earlier_calibration"] for arm in summary)
        rows.append(
            {
                " / ".join(f"`{arm}`" for arm in arms): name + (EARLIER if earlier else ""),
                "car": known["vehicle"],
                "route": settings["route"],
                "window [m]": f"{settings['window']:g}",
                "top speed [m/s]": f"{settings['v_max']:g}",
                "episodes": known["episodes"],
                **{
                    f"`{arm}` / `known`": interval(summary[arm]["time_ratio"], ".2f")
                    if arm in summary
                    else DASH
                    for arm in ratios
                },
                "SCT": each("sct", ".3f"),
                "detour": each("detour", ".2f"),
                **{key: each(key, "d") for key in ("reached", "stuck", "collided")},
            }
        )
    return records(rows)


def reliances(runs: dict[str, dict[str, Any]]) -> str:
    """Return a table of the reliance and the broken promises of `predicted`, one line per run.

    Args:
        runs: name → contents of a results.json of `benchmarks.corridor`, `summarised`.
    """
    rows = []
    for name, run in runs.items():
        settings, entry = up_to_date(run["settings"]), run["summary"]["predicted"]
        rows.append(
            {
                "run": name,
                "predictor": f"`{Path(settings['predictor']).stem}`",
                "expansion": f"{settings['expansion']:g}",
                "reliance": f"{settings['reliance']:g}",
                "promises broken (95 % over worlds)": broken(entry),
                **{key: entry[key] for key in ("episodes", "reached", "collided")},
                "SCT": figure(entry["sct"], entry["sct_interval"], ".3f"),
                "speed [m/s]": figure(entry["mean_speed"], entry["mean_speed_interval"], ".2f"),
            }
        )
    return records(rows)


def scores(runs: dict[str, dict[str, Any]]) -> str:
    """Return a table of scores, one line for each predictor on each group of buildings.

    Args:
        runs: name → contents of a results.json of `predictor.evaluate`.
    """
    columns = ("iou_free", "iou_occupied", "auc_free", "brier_free", "nll", "ece_free", "ssim")
    rows = [
        {"buildings": group, "predictor": f"`{name}`"}
        | {
            column.replace("_", " "): "" if row.get(column) is None else f"{row[column]:.3f}"
            for column in columns
        }
        for run in runs.values()
        for group, entry in run["groups"].items()
        for name, row in entry["predictors"].items()
        if "(" not in name
    ]
    return records(rows)
