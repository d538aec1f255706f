"""JSON from untrusted files: whatever is wrong with one is a ValueError."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

MOST_BYTES = 100_000_000
"""Largest file that is read [bytes]; the largest published results have a tenth of it."""


def read_json(path: Path, most: int = MOST_BYTES) -> Any:
    """Read a JSON file.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, too large, or not valid JSON.
    """
    with path.open("rb") as file:
        # A device may never end; a folder raises an OSError when it is opened.
        if not path.is_file():
            raise ValueError("it is no regular file")
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has over {most} bytes")
    return loads(data)


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
