"""Error messages of one line.

Text from files and plug-ins may contain anything, so it is escaped and cut before it is shown.
"""

from __future__ import annotations

LONGEST = 1000
"""Length above which a message is cut [characters]."""


def shown(text: str, longest: int = LONGEST) -> str:
    """Return a text as one line, with control characters escaped and the middle cut if too long.

    Args:
        text: text of any kind.
        longest: length above which it is cut [characters].
    """
    line = " ".join(text.split())
    if not line.isprintable():
        line = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
    if len(line) > longest:
        line = f"{line[: longest // 2]} … {line[-longest // 2 :]}"
    return line


def one_line(error: BaseException) -> str:
    """Return the class name and the message of an error as one line."""
    kind = type(error).__name__
    try:
        message = shown(str(getattr(error, "strerror", None) or error))
    except Exception:
        # Converting the error of a plug-in to text may itself raise.
        message = ""
    return f"{kind}: {message}" if message else kind


class LineError(ValueError):
    """An error whose message is one line, which `Command` prints without a traceback.

    Attributes:
        status: exit status of the command that the error ends.
    """

    status = 2

    def __init__(self, message: str) -> None:
        super().__init__(shown(message))
