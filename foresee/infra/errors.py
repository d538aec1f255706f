"""Error messages of one line.

Text from files and plug-ins may contain anything, so it is escaped and cut before it is shown.
"""

from __future__ import annotations

LONGEST = 1000
"""Length above which a message is cut [characters]."""


def shown(text: str) -> str:
    """Return a text as one line, with control characters escaped and the middle cut if too long."""
    words = " ".join(text.split())
    if not words.isprintable():
        words = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in words)
    if len(words) > LONGEST:
        words = f"{words[: LONGEST // 2]} … {words[-LONGEST // 2 :]}"
    return words


def one_line(error: BaseException) -> str:
    """Return the class name and the message of an error as one line."""
    kind = type(error).__name__
    try:
        said = shown(str(getattr(error, "strerror", None) or error))
    except Exception:
        # Converting the error of a plug-in to text may itself raise.
        said = ""
    return f"{kind}: {said}" if said else kind


class LineError(ValueError):
    """An error whose message is one line, which `Command` prints without a traceback."""

    def __init__(self, said: str) -> None:
        super().__init__(shown(said))
