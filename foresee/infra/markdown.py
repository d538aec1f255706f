"""Tables in Markdown, and numbers with their intervals."""

from __future__ import annotations

from typing import Any

DASH = "–"
"""Text in place of a missing value, such as an interval over too few worlds."""


def markdown(rows: list[list[str]]) -> str:
    """Return a Markdown table with padded cells; the first row is the header."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]])


def records(rows: list[dict[str, Any]]) -> str:
    """Return a Markdown table of rows with equal keys, which make the header; "" without rows."""
    return markdown([[*rows[0]], *([*map(str, row.values())] for row in rows)]) if rows else ""


def figure(value: float | None, ends: list[float] | None, form: str) -> str:
    """Return a value and its 95 % interval as text, "0.46 (0.39–0.54)"; "" without a value.

    Args:
        value: the value; None: there is none.
        ends: both ends of the interval; None: `DASH` in its place.
        form: format of the numbers, such as ".2f".
    """
    if value is None:
        return ""
    told = DASH if ends is None else "–".join(format(end, form) for end in ends)
    return f"{format(value, form)} ({told})"


def interval(value: dict[str, Any], form: str, factor: float = 1.0) -> str:
    """Return a value and its 95 % interval as text, "0.90 (0.75 to 1.01)".

    Args:
        value: `value`, `low` and `high`; if `low` is None, `DASH` stands for the interval.
        form: format of the numbers, such as ".2f".
        factor: factor that all three are multiplied by, such as 100 for percentages.
    """
    mid = format(factor * value["value"], form)
    if value["low"] is None:
        return f"{mid} ({DASH})"
    low, high = (format(factor * value[name], form) for name in ("low", "high"))
    return f"{mid} ({low} to {high})"
