"""The tables of the study, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from benchmarks.runs.summary import EARLIER, NOT_CERTIFIED
from foresee.infra.markdown import interval, records

HEADS = {
    "prescribed": "Prescribed route, window {window:g} m, top speed {v_max:g} m/s",
    "windows": "Prescribed route, window {window:g} m, top speed {v_max:g} m/s",
    "free": "Free route, `reeds-shepp`, window {window:g} m, top speed {v_max:g} m/s",
}
"""Part of the study → heading of a table."""


def tables(results: dict[str, Any]) -> str:
    """Return the results of the study as Markdown: a table for each kind of buildings and car."""
    parts = []
    group = ("part", "tasks", "window", "v_max")
    for key, rows in groupby(results["rows"], key=lambda row: [row[name] for name in group]):
        place = dict(zip(group, key, strict=True))
        head = HEADS[place["part"]].format(**place)
        parts.append(f"**{head}: {place['tasks']}**\n\n{_table([*rows])}")
    parts += [f"- {line}" for line in results["without_calibration"]]
    if results["missing"]:
        parts.append(f"{results['missing']} drives are still to be made: the same command goes on.")
    return "\n\n".join(parts)


def _table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                f"{row['episodes']} buildings": _head(row),
                "time ratio to `known`": interval(row["time_ratio"], ".2f"),
                "time over the best baseline": _over(row),
                "gap closed [%]": interval(row["gap_closed"], ".0f", 100.0),
                "SCT": interval(row["sct"], ".3f"),
                "reached": row["reached"],
                "collided": row["collided"],
                "hard stops": row["hard_stops"],
                "promises broken [%]": interval(row["promises_broken"], ".1f", 100.0),
            }
            for row in rows
        ]
    )


def _head(row: dict[str, Any]) -> str:
    """Return the name of a driver, and how far its risk is certified."""
    if not row["risk"]:
        return f"`{row['driver']}`"
    remark = NOT_CERTIFIED
    if row["certified"]:
        remark = EARLIER if row["earlier_calibration"] else ""
    return f"`{row['driver']}` (λ = {row['level']:g}){remark}"


def _over(row: dict[str, Any]) -> str:
    if row["time_over_baseline"] is None:
        return ""
    return f"{interval(row['time_over_baseline'], '.2f')} of `{row['baseline']}`"
