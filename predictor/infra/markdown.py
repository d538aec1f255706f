"""Tables in Markdown, and figures with their intervals."""

from __future__ import annotations

from typing import Any

DASH = "–"
"""In place of an interval that is not given: there are too few worlds."""


def markdown(rows: list[list[str]]) -> str:
    """Return a padded table whose first row is its head."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]])


def records(rows: list[dict[str, Any]]) -> str:
    """Return a padded table of rows with equal keys, which are its head; "" without rows."""
    return markdown([[*rows[0]], *([*map(str, row.values())] for row in rows)]) if rows else ""


def figure(value: float | None, ends: list[float] | None, form: str) -> str:
    """Return a value and the ends of its 95 % interval; "" without a value."""
    if value is None:
        return ""
    told = DASH if ends is None else "–".join(format(end, form) for end in ends)
    return f"{format(value, form)} ({told})"


def interval(value: dict[str, Any], form: str, factor: float = 1.0) -> str:
    """Return a value and its 95 % interval, or a dash in its place."""
    mid = format(factor * value["value"], form)
    if value["low"] is None:
        return f"{mid} ({DASH})"
    low, high = (format(factor * value[name], form) for name in ("low", "high"))
    return f"{mid} ({low} to {high})"
