"""The tables of the study, as Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from benchmarks.studies.risk.series import PROMISE
from foresee.infra.markdown import DASH, interval, records, span


def tables(found: dict[str, Any]) -> str:
    """Return the results of the study as Markdown."""
    parts = [_collision_table(found["promise"])]
    if found["pareto"]:
        parts.append(_speed_table(found["pareto"]))
    if families := _family_table(found["pareto"]):
        parts.append(families)
    if found.get("pooled"):
        parts.append(_pooled_table(found["pooled"]))
    if found.get("recalibrations"):
        parts.append(_recalibration_table(found["recalibrations"]))
    if found["missing"]:
        parts.append(f"{found['missing']} drives are still to be made: the same command goes on.")
    return "\n\n".join(parts)


def _collision_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "group": row["group"],
                "drives in": row["series"],
                "requested δ": DASH if row["requested"] is None else f"{row['requested']:g}",
                "level λ": f"{row['level']:.2g}",
                "collided": f"{row['collided']} of {row['drives']}",
                "rate (95 %)": span(row["interval"], ".1f", 100.0, " %"),
                "per km (95 %)": span(row["per_km_interval"], ".2f"),
                "reached / stuck / timed out / no task": " / ".join(
                    str(n)
                    for n in (
                        *(
                            row["outcomes"].get(name, 0)
                            for name in ("reached", "stuck", "timed_out")
                        ),
                        row["no_task"],
                    )
                ),
                "SCT": DASH if row["sct"] is None else f"{row['sct']:.3f}",
                "BARN": DASH if row["barn"] is None else f"{row['barn']:.3f}",
                "speed [m/s]": f"{row['speed']:.2f}",
            }
            for row in rows
        ]
    )


def _speed_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "group": row["group"],
                "series": row["series"],
                "arm": row["arm"],
                "level λ": f"{row['level']:.2g}",
                "episodes": row["episodes"],
                "collided": row["collided"],
                "SCT": _told(row["sct"], ".3f"),
                "time ratio to `known`": _told(row["time_ratio"], ".2f"),
                "time over that of `full`": _told(row["time_over_full"], ".2f"),
                "share of the gap in time [%]": _told(
                    row["share_of_gap"].get("time"), ".0f", 100.0
                ),
            }
            for row in rows
        ]
    )


def _family_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the times in each family of a mixture as Markdown; "" if there is no mixture."""
    return records(
        [
            {
                "series": row["series"],
                "family": family,
                "time ratio to `known`": _told(times["time_ratio"], ".2f"),
                "share of the gap in time [%]": _told(times["share_of_gap"], ".0f", 100.0),
            }
            for row in rows
            if row["group"] == PROMISE and row["arm"] == "predicted"
            for family, times in row.get("time_by_family", {}).items()
        ]
    )


def _pooled_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "requested δ": f"{row['requested']:g}",
                "level λ of each calibration": ", ".join(
                    f"{name} {level:g}" for name, level in row["levels"].items()
                ),
                "collided": f"{row['collided']} of {row['drives']}",
                "rate (95 %)": span(row["interval"], ".1f", 100.0, " %"),
                "time ratio to `known`": _told(row["time_ratio"], ".2f"),
                "share of the gap in time [%]": _told(row["share_of_gap"], ".0f", 100.0),
            }
            for row in rows
        ]
    )


def _recalibration_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "block": row["block"] + 1,
                "requested δ": f"{row['requested']:g}",
                "certified level λ": f"{row['level']:g}" if row["level"] else DASH,
                "collided in the other blocks": (
                    f"{row['collided']:.0f} of {row['drives']}" if row["drives"] else DASH
                ),
            }
            for row in rows
        ]
    )


def _told(estimate: dict[str, Any] | None, form: str, scale: float = 1.0) -> str:
    return DASH if estimate is None else interval(estimate, form, scale)


def table_of_drives(found: dict[str, Any]) -> str:
    """Return the outcomes of the drives of one series as Markdown."""
    outcomes = Counter(drive["outcome"] for drive in found["drives"])
    return records([{"outcome": name, "drives": count} for name, count in sorted(outcomes.items())])
