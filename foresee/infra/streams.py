"""Standard streams of a command: closed ones, and characters that a terminal cannot show."""

from __future__ import annotations

import codecs
import contextlib
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

PLAIN = {
    "–": "-",
    "−": "-",
    "·": "*",
    "…": "...",
    "×": "x",
    "≤": "<=",
    "≥": ">=",
    "→": "->",
    "½": "1/2",
    "²": "^2",
    "δ": "delta",
    "ε": "epsilon",
    "λ": "lambda",
    "σ": "sigma",
}
"""Character of our tables and messages → how it is written in ASCII."""


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Make the standard streams usable for a command, whatever the process was started with.

    A stream that is closed is opened on the null device. A character that a stream's encoding lacks
    is transliterated. Messages to stderr are dropped once its reader or terminal is gone, and do
    not end the work. At its end, Python does not complain about a broken stream.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: SIM115
            # Unless something else has its number, a file that is opened later cannot get it, which
            # libraries in C would then write into.
            if null.fileno() == number:
                os.set_inheritable(number, True)
            setattr(sys, name, null)
    for stream in (sys.stdout, sys.stderr):
        # Other streams, such as those of a notebook, take all characters.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="foresee.transliterate")
    stderr = sys.stderr
    if not isinstance(stderr, _Unbreakable):
        sys.stderr = cast(TextIO, _Unbreakable(stderr))
    try:
        yield
    finally:
        sys.stderr = stderr
        for stream in (sys.stdout, sys.stderr):
            _flush(stream)


class _Unbreakable:
    """A stream that drops what cannot be written."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        _flush(self._stream)


def _flush(stream: TextIO) -> None:
    """Flush a stream; if it is broken, connect it to the null device, which takes its buffer."""
    try:
        stream.flush()
    except (OSError, ValueError):
        # A stream in memory has no number.
        with contextlib.suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)


def _transliterated(error: UnicodeError) -> tuple[str | bytes, int]:
    """Return a replacement for the first character that cannot be encoded, and where to go on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    if 0xDC80 <= ord(character) <= 0xDCFF:
        # A byte of a file's name that is no text.
        return bytes([ord(character) - 0xDC00]), error.start + 1
    decomposed = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return PLAIN.get(character, decomposed or "?"), error.start + 1


codecs.register_error("foresee.transliterate", _transliterated)
