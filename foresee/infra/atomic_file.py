"""Files that are written atomically: whole or not at all."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_OURS = f"@{platform.node()}.tmp"
"""End of the name of a temporary file, after the number of its process: another machine may work
in the same folder."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file, which at the end replaces a file, or is removed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}{_OURS}")
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under another name, then rename it, so that it is never incomplete."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def clear(folder: Path) -> None:
    """Remove temporary files of `replacing`, of processes that have ended, from a folder and the
    folders in it."""
    for pattern in (f".*{_OURS}", f"*/.*{_OURS}"):
        for path in folder.glob(pattern):
            number = re.search(r"\.(\d+)@", path.name)
            if number and not _runs(int(number[1])):
                path.unlink(missing_ok=True)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        # The process belongs to another user, or the number is none of a process.
        pass
    return True
