"""The folder in which a user's processes keep what they have compiled."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path


def cache_folder() -> Path | None:
    """Return this project's cache folder; None if there is none that can be written.

    It is the user's, or a folder beside other temporary files if the user has no home folder or
    cannot write to it, as in containers and services.
    """
    return next((folder for folder in _candidates() if is_writable(folder)), None)


def is_writable(folder: Path) -> bool:
    """Make a folder if it is missing, and return whether files can be made in it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _candidates() -> Iterator[Path]:
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # An error if neither HOME nor the list of users names a home folder.
    with contextlib.suppress(RuntimeError):
        yield (given if given.is_absolute() else Path.home() / ".cache") / "foresee"
    try:
        temporary = Path(tempfile.gettempdir()) / f"foresee-{os.getuid()}"
    except FileNotFoundError:
        # No folder for temporary files can be written.
        return
    # Its files are run, so another user must not have made the folder.
    if is_writable(temporary) and _is_private(temporary):
        yield temporary


def _is_private(folder: Path) -> bool:
    status = folder.lstat()
    open_to_others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not open_to_others
