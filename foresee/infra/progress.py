"""Progress of long work: a bar in a terminal, and sparse lines elsewhere, such as in a log file."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, TextIO

from tqdm import tqdm

SPARSE = 60.0
"""Least time between two lines where stderr is no terminal [s]."""


def progress(items: Iterable[Any] | None = None, **options: Any) -> tqdm[Any]:
    """Return a progress bar on stderr.

    A bar that is drawn again and again would flood a file. Where stderr is no terminal, whole lines
    are written: one at the start, at most one in `SPARSE` seconds, and one at the end.

    Args:
        items: items to iterate over; None: `update` of the bar counts them.
        options: further arguments of `tqdm.tqdm`.
    """
    if not sys.stderr.isatty():
        options |= {"file": _Lines(sys.stderr), "mininterval": SPARSE, "miniters": 1}
    return tqdm(items, **options)


class _Lines:
    """A stream that writes each state of a bar as a line, without control characters.

    Args:
        stream: stream that gets the lines.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        if line := text.strip():
            self._stream.write(f"{line}\n")

    def flush(self) -> None:
        self._stream.flush()
