"""Files of one part of a computation: facts and arrays in one NumPy archive."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.atomic_file import write_whole
from foresee.infra.plain_json import loads
from foresee.infra.plain_npz import MOST_BYTES, read_npz

Part = tuple[dict[str, Any], dict[str, NDArray[Any]]]
"""One part of the results: facts (plain data for JSON), and arrays by name."""


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], compress: bool = True) -> None:
    """Write arrays to a NumPy archive (.npz) atomically.

    Args:
        path: path of the file.
        arrays: arrays by name.
        compress: whether to compress them.
    """
    buffer = io.BytesIO()
    (np.savez_compressed if compress else np.savez)(buffer, allow_pickle=False, **arrays)
    write_whole(path, buffer.getvalue())


def write_part(
    path: Path,
    facts: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    key: str = "facts",
    compress: bool = True,
) -> None:
    """Write facts and arrays to one NumPy archive atomically; `read_part` reads them.

    Args:
        path: path of the file.
        facts: plain data, which are stored as JSON in an array of bytes.
        arrays: arrays by name.
        key: name of the array with the facts.
        compress: whether to compress the arrays.
    """
    text = np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)
    write_arrays(path, {**arrays, key: text}, compress)


def read_part(path: Path, key: str = "facts", most: int = MOST_BYTES) -> Part:
    """Read facts and arrays without running code from their file.

    Args:
        path: path of the file.
        key: name of the array with the facts.
        most: largest size of all arrays [bytes].

    Raises:
        OSError: if the file cannot be read.
        ValueError: if it is damaged, too large, or has no facts.
    """
    arrays = read_npz(path, most)
    if key not in arrays:
        raise ValueError(f"it has no {key}")
    facts = loads(arrays.pop(key).tobytes())
    if not isinstance(facts, dict):
        raise ValueError(f"its {key} are no JSON object")
    return facts, arrays
