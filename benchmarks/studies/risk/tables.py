"""The tables of the study, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.runs.summary_text import EARLIER
from benchmarks.studies.risk.series import PROMISE
from foresee.infra.markdown import DASH, interval, records, span


def tables(results: dict[str, Any]) -> str:
    """Return the results of the study as Markdown."""
    parts = [
        _collision_table(results["promise"]),
        _speed_table(results["pareto"]),
        _family_table(results["pareto"]),
        _pooled_table(results["pooled"]),
    ]
    if results["missing"]:
        parts.append(f"{results['missing']} drives are still to be made: the same command goes on.")
    return "\n\n".join(part for part in parts if part)


def _collision_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "group": row["group"],
                "drives in": row["series"] + (EARLIER if row.get("earlier_calibration") else ""),
                "requested risk": _number(row["requested"], "g"),
                "level": f"{row['level']:.2g}",
                **_collisions(row),
                "per km (95 %)": span(row["per_km_interval"], ".2f"),
                "reached / stuck / timed out / no task": " / ".join(
                    str(row["outcomes"].get(name, 0)) for name in ("reached", "stuck", "timed_out")
                )
                + f" / {row['no_task']}",
                "SCT": _number(row["sct"], ".3f"),
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
                "level": f"{row['level']:.2g}",
                "episodes": row["episodes"],
                "collided": row["collided"],
                "SCT": _estimate(row["sct"], ".3f"),
                "time ratio to `known`": _estimate(row["time_ratio"], ".2f"),
                "time over that of `full`": _estimate(row["time_over_full"], ".2f"),
            }
            for row in rows
        ]
    )


def _family_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the times in each family of a mixture as Markdown; "" if there is no mixture."""
    return records(
        [
            {"series": row["series"], "family": family, **_times(times)}
            for row in rows
            if row["group"] == PROMISE and row["arm"] == "predicted"
            for family, times in row["time_by_family"].items()
        ]
    )


def _pooled_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "requested risk": f"{row['requested']:g}",
                "level of each calibration": ", ".join(
                    f"{name} {level:g}" for name, level in row["levels"].items()
                ),
                **_collisions(row),
                **_times(row),
            }
            for row in rows
        ]
    )


def _collisions(row: dict[str, Any]) -> dict[str, str]:
    rate = span(row["interval"], ".1f", 100.0, " %")
    return {"collided": f"{row['collided']} of {row['drives']}", "rate (95 %)": rate}


def _times(row: dict[str, Any]) -> dict[str, str]:
    return {"time ratio to `known`": _estimate(row["time_ratio"], ".2f")}


def _number(value: float | None, form: str) -> str:
    return DASH if value is None else format(value, form)


def _estimate(value: dict[str, Any] | None, form: str) -> str:
    return DASH if value is None else interval(value, form)
