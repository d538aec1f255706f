"""Tables in Markdown, and numbers with their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

DASH = "–"
"""Text in place of a missing value, such as an interval over too few worlds."""


def markdown(rows: list[list[str]]) -> str:
    """Return a Markdown table with padded cells; the first row is the header.

    A bar in a cell, such as in the name of a map, is escaped.
    """
    rows = [[cell.replace("|", r"\|") for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]])


def records(rows: list[dict[str, Any]]) -> str:
    """Return a Markdown table of rows with equal keys, which make the header; "" without rows."""
    return markdown([[*rows[0]], *([*map(str, row.values())] for row in rows)]) if rows else ""


def interval(
    estimate: Mapping[str, Any] | None, form: str, factor: float = 1.0, unit: str = ""
) -> str:
    """Return an estimate and its 95 % interval as text, "0.87 (0.86–0.88)"; "" without an estimate.

    Args:
        estimate: `value`, `low` and `high`; the ends are None if there is no interval.
        form: format of the numbers, such as ".2f".
        factor: factor that all three are multiplied by, such as 100 for percentages.
        unit: text after a number, such as " %".
    """
    if estimate is None:
        return ""
    low, high = estimate["low"], estimate["high"]
    return figure(estimate["value"], None if low is None else (low, high), form, factor, unit)


def figure(
    value: float | None,
    ends: Sequence[float] | None,
    form: str,
    factor: float = 1.0,
    unit: str = "",
) -> str:
    """Return a value and both ends of its interval as text, see `interval`; "" without a value."""
    if value is None:
        return ""
    return f"{format(factor * value, form)} ({span(ends, form, factor)}){unit}"


def span(ends: Sequence[float] | None, form: str, factor: float = 1.0, unit: str = "") -> str:
    """Return both ends of an interval as text, "0.86–0.88", or with signs "-0.1 to 0.2".

    Without ends, it is `DASH`.
    """
    if ends is None:
        return DASH
    texts = [format(factor * end, form) for end in ends]
    signed = any(text.startswith(("+", "-")) for text in texts)
    return (" to " if signed else "–").join(texts) + unit
