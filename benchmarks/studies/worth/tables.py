"""The tables of the study, as Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from benchmarks.runs.summary_text import EARLIER, NOT_CERTIFIED
from benchmarks.studies.worth.series import WINDOWS
from foresee.infra.markdown import interval, records

HEADS = {
    "prescribed": "Prescribed route, window {window:g} m, top speed {v_max:g} m/s",
    "windows": "Prescribed route, window {window:g} m, top speed {v_max:g} m/s",
    "free": "Free route, `reeds-shepp`, window {window:g} m, top speed {v_max:g} m/s",
}
"""Part of the study → heading of a table."""
TIME = "time ratio to `known`"
"""Name of the measure that the tables give for each driver."""
SLOWER = 1.02
"""Time ratio above which a driver counts as slower than `known`, also without an interval."""


def tables(results: dict[str, Any]) -> str:
    """Return the results of the study as Markdown: a table for each kind of buildings and car."""
    parts = []
    group = ("part", "tasks", "window", "v_max")
    for key, rows in groupby(results["rows"], key=lambda row: [row[name] for name in group]):
        place = dict(zip(group, key, strict=True))
        head = HEADS[place["part"]].format(**place)
        parts.append(f"**{head}: {place['tasks']}**\n\n{_table([*rows])}")
    if cells := _cells(results["rows"]):
        parts.append(f"**Prescribed route at a risk of 0: {TIME} in each family**")
        parts += [records(cells), _slower(results["rows"])]
    parts += [f"- {line}" for line in results["left_out"]]
    if results["missing"]:
        parts.append(f"{results['missing']} drives are still to be made: the same command goes on.")
    return "\n\n".join(parts)


def _table(rows: Sequence[dict[str, Any]]) -> str:
    return records(
        [
            {
                f"{row['episodes']} buildings": _head(row),
                TIME: interval(row["time_ratio"], ".2f"),
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


def _cells(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each window, top speed and family, with the time ratio of each driver."""
    cells: dict[tuple[float, float, str], dict[str, Any]] = {}
    for row, family, ratio in _by_family(rows):
        key = (row["window"], row["v_max"], family)
        where = {"window [m]": f"{key[0]:g}", "top speed [m/s]": f"{key[1]:g}", "family": family}
        cells.setdefault(key, where)[f"`{row['driver']}`"] = interval(ratio, ".2f")
    drivers = dict.fromkeys(name for cell in cells.values() for name in cell)
    return [dict.fromkeys(drivers, "") | cell for cell in cells.values()]


def _slower(rows: Sequence[dict[str, Any]]) -> str:
    """Return a line that names the drivers that are slower than `known` in a family."""
    found = [
        f"`{row['driver']}` in `{family}` (window {row['window']:g} m, {row['v_max']:g} m/s)"
        for row, family, ratio in _by_family(rows)
        if ratio["value"] > SLOWER or (ratio["low"] or 0.0) > 1.0
    ]
    rule = f"a ratio above {SLOWER:g}, or an interval above 1"
    return f"Slower than `known` ({rule}): {', '.join(found) or 'none'}."


def _by_family(
    rows: Sequence[dict[str, Any]],
) -> Iterator[tuple[dict[str, Any], str, dict[str, Any]]]:
    """Yield each row of a driver at a risk of 0 on a prescribed route, a family and its ratio."""
    for row in rows:
        if row["part"] == WINDOWS and not row["risk"] and row["driver"] != "known":
            for family, ratio in row["by_family"].items():
                yield row, family, ratio


def _head(row: dict[str, Any]) -> str:
    """Return the name of a driver, and how far its risk is certified."""
    if not row["risk"]:
        return f"`{row['driver']}`"
    remark = NOT_CERTIFIED
    if row["certified"]:
        remark = EARLIER if row["earlier_calibration"] else ""
    return f"`{row['driver']}` (level {row['level']:g}){remark}"


def _over(row: dict[str, Any]) -> str:
    if row["time_over_baseline"] is None:
        return ""
    return f"{interval(row['time_over_baseline'], '.2f')} of `{row['baseline']}`"
