"""Input files that nobody has checked: regular files of a sensible size."""

from __future__ import annotations

import stat
from pathlib import Path


def check_input(path: Path, most: int) -> None:
    """Check, without opening it, that a path names a regular file that is not too large.

    A device may never end, and a pipe is waited for when it is opened.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if there is no such file.
        ValueError: if it is no regular file, or too large.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("it is no regular file")
    if status.st_size > most:
        raise ValueError(f"it has over {most} bytes")


def read_input(path: Path, most: int) -> bytes:
    """Read a regular file.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, or too large.
    """
    check_input(path, most)
    with path.open("rb") as file:
        # The files of some file systems, such as /proc, are larger than they say.
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has over {most} bytes")
    return data
