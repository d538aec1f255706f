"""JSON from untrusted files: whatever is wrong with one is a ValueError."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

from foresee.infra.input_file import read_input

MOST_BYTES = 100_000_000
"""Largest file that is read [bytes]; the largest published results have a tenth of it."""
FARTHEST = 1e9
"""Largest number accepted from a file; larger ones cannot be drawn."""


def read_json(path: Path, most: int = MOST_BYTES) -> Any:
    """Read a JSON file.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, too large, or not valid JSON.
    """
    return loads(read_input(path, most))


def loads(text: str | bytes, *, unique: bool = False) -> Any:
    """Parse a JSON text.

    Args:
        text: the text.
        unique: whether to refuse an object that has a name twice; else the last value counts.

    Raises:
        ValueError: if it is not valid JSON, or nested too deeply for Python's parser.
    """
    try:
        return json.loads(text, object_pairs_hook=_unique if unique else None)
    except RecursionError:
        raise ValueError("it is nested too deep") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object, whose names must differ."""
    entries = dict[str, Any]()
    for name, value in pairs:
        if name in entries:
            raise ValueError(f"it names {name} twice")
        entries[name] = value
    return entries


def read_object(path: Path, most: int = MOST_BYTES) -> dict[str, Any]:
    """Read a file that holds a JSON object.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, too large, not valid JSON, or no object.
    """
    value = read_json(path, most)
    if not isinstance(value, dict):
        raise ValueError("it holds no object")
    return value


def fits(value: Any, hint: Any) -> bool:
    """Return whether a JSON value has an annotated type, with numbers up to `FARTHEST`.

    Args:
        value: value that `loads` has returned.
        hint: str, bool, int, float, None, a union of these, or a list, tuple or dict of them; a
            tuple stands for a list of any length, int is a float, too.
    """
    kind, inner = get_origin(hint), get_args(hint)
    if kind is UnionType:
        return any(fits(value, choice) for choice in inner)
    if kind is dict:
        return isinstance(value, dict) and all(fits(v, inner[1]) for v in value.values())
    if kind in (list, tuple):
        return isinstance(value, list) and all(fits(entry, inner[0]) for entry in value)
    if hint in (str, bool, NoneType):
        return isinstance(value, hint)
    numbers = int | float if hint is float else int
    return isinstance(value, numbers) and not isinstance(value, bool) and abs(value) <= FARTHEST


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
