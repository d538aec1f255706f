"""JSON from untrusted files: as `json.loads`, but too deep nesting is also a ValueError."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any


def loads(text: str | bytes) -> Any:
    """Parse a JSON text.

    Raises:
        ValueError: if it is not valid JSON, or nested too deeply for Python's parser.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None


def read_object(path: Path) -> dict[str, Any]:
    """Read a file that holds a JSON object.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is not valid JSON, nested too deeply, or no object.
    """
    value = loads(path.read_text(encoding="utf-8"))
    if not isinstance(value, dict):
        raise ValueError("it holds no object")
    return value


def without_nan(value: Any, digits: int | None = None) -> Any:
    """Return data with None in place of NaN and infinity, which JSON does not have.

    Args:
        value: dictionaries, lists, tuples and plain values.
        digits: significant digits to which numbers are rounded; None: not rounded.
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
