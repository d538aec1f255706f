"""Errors of one line: what others hand over may say anything, and is shown escaped and cut."""

from __future__ import annotations

LONGEST = 1000
"""Longer messages are cut [characters]."""


def shown(text: str) -> str:
    """Return a text on one line: control characters escaped, the middle left out if it is long."""
    words = " ".join(text.split())
    if not words.isprintable():
        words = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in words)
    if len(words) > LONGEST:
        words = f"{words[: LONGEST // 2]} … {words[-LONGEST // 2 :]}"
    return words


def one_line(error: BaseException) -> str:
    """Return the kind of an error and what it says, on one line."""
    kind = type(error).__name__
    try:
        said = shown(str(getattr(error, "strerror", None) or error))
    except Exception:
        # A stranger's error may not even be shown.
        said = ""
    return f"{kind}: {said}" if said else kind


class LineError(ValueError):
    """An error that people are told in one line."""

    def __init__(self, said: str) -> None:
        super().__init__(shown(said))
