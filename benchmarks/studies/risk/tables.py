"""The tables of the study, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.runs.summary_text import EARLIER
from benchmarks.studies.risk.series import PROMISE
from foresee.infra.markdown import DASH, interval, records, span
from foresee.mapping.family_names import FAMILIES
from foresee.statistics import MIN_GROUPS, of_percentiles


def tables(results: dict[str, Any]) -> str:
    """Return the results of the study as Markdown."""
    results = with_intervals(results)
    parts = [
        _collision_table(results["promise"]),
        _speed_table(results["pareto"]),
        _family_table(results["pareto"]),
        _pooled_table(results.get("pooled", [])),
        _recalibration_table(results.get("recalibrations", [])),
    ]
    if results["missing"]:
        parts.append(f"{results['missing']} drives are still to be made: the same command goes on.")
    return "\n\n".join(part for part in parts if part)


def with_intervals(results: dict[str, Any]) -> dict[str, Any]:
    """Return results of the study in which all intervals are over enough buildings.

    Earlier versions recorded percentiles of a bootstrap, and intervals of collisions over drives,
    not over buildings. A drive in a generated building was in a building of its own; of drives in
    maps, the number of maps is not recorded, and no interval is given.
    """
    rows = {
        part: [_with_intervals(row) for row in results.get(part, [])]
        for part in ("promise", "pareto", "pooled")
    }
    return results | rows


def _with_intervals(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of the study, see `with_intervals`."""
    generated = set(row.get("world", ())) <= set(FAMILIES)

    def amended(value: Any, worlds: int) -> Any:
        if not isinstance(value, dict) or "groups" in value:
            return value
        if "low" in value:
            return of_percentiles(value, worlds if generated else 0)
        worlds = (value.get("time_ratio") or value).get("episodes", worlds)
        return {key: amended(entry, worlds) for key, entry in value.items()}

    new: dict[str, Any] = amended(row, 0)
    if "drives" in row and "worlds" not in row and (not generated or row["drives"] < MIN_GROUPS):
        new |= {name: None for name in ("interval", "per_km_interval") if name in row}
    return new


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
            for family, times in row.get("time_by_family", {}).items()
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


def _recalibration_table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                "block": row["block"] + 1,
                "requested risk": f"{row['requested']:g}",
                "certified level": _number(row["level"] or None, "g"),
                "collided in the other blocks": (
                    f"{row['collided']:.0f} of {row['drives']}" if row["drives"] else DASH
                ),
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
