"""JSON from strangers: as `json.loads`, but what is nested too deep is a ValueError too."""

from __future__ import annotations

import json
import math
from typing import Any


def loads(text: str | bytes) -> Any:
    """Return the value of a text.

    Raises:
        ValueError: if it is no JSON, or nested deeper than Python can follow.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None


def without_nan(value: Any, digits: int | None = None) -> Any:
    """Return plain data with null for NaN and infinity, which JSON does not have.

    Args:
        value: dictionaries, lists, tuples and plain values.
        digits: significant digits that numbers are rounded to; None: all.
    """
    if isinstance(value, dict):
        return {key: without_nan(entry, digits) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(entry, digits) for entry in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    return value
