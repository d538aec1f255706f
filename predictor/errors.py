"""What an error says, for a message of one line."""

from __future__ import annotations

LONGEST = 300
"""Longer messages are cut [characters]."""


def one_line(error: BaseException) -> str:
    """Return the kind of an error and what it says, on one line, control characters escaped."""
    kind = type(error).__name__
    try:
        said = str(getattr(error, "strerror", None) or error)
    except Exception:
        # A stranger's error may not even be shown.
        said = ""
    words = " ".join(said.split())
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in words)
    if len(shown) > LONGEST:
        shown = shown[:LONGEST] + " …"
    return f"{kind}: {shown}" if shown else kind
