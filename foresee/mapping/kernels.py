"""The cache of kernels compiled by numba: all are compiled again when any of them changes.

Import `njit` from here, not from numba: this module first sets the folder of numba's cache.

numba recompiles a kernel only when the kernel's own file changes. A kernel that calls a kernel of
another file would keep using that one's old code, which is not acceptable in code that decides
about collisions. The cache folder is therefore named after a hash of the sources of all kernels. It
lies in the package, or in the user's cache folder if the package cannot be written.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import time
from pathlib import Path

from numba import config, njit

__all__ = ["cache", "njit"]

UNUSED = 7 * 86400.0
"""Time after which a cache folder that no process has used is deleted [s]."""


def stamp(root: Path) -> str:
    """Return a hash of the sources of all kernels.

    Args:
        root: folder that contains the packages.
    """
    digest = hashlib.sha256()
    for package in ("foresee", "sim", "planner", "predictor", "benchmarks"):
        for path in sorted((root / package).rglob("*.py")):
            source = path.read_bytes()
            if b"@njit" in source:
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()[:16]


def cache() -> Path:
    """Return this project's folder in the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "foresee"


def kept(place: Path, stamp: str) -> Path | None:
    """Make the cache folder of a stamp, and return it; None if it cannot be written.

    Folders of other stamps are deleted once they have not been used for `UNUSED`, so that running
    processes keep theirs.

    Args:
        place: parent folder.
        stamp: hash of the kernels' sources.
    """
    mine = place / f"kernels-{stamp}"
    try:
        mine.mkdir(parents=True, exist_ok=True)
        os.utime(mine)
    except OSError:
        return None
    if not os.access(mine, os.W_OK):
        return None
    for other in place.glob("kernels-*"):
        # Another process may be removing it too.
        with contextlib.suppress(OSError):
            if other.stat().st_mtime < time.time() - UNUSED:
                shutil.rmtree(other)
    return mine


if not config.CACHE_DIR:  # type: ignore[attr-defined]
    # The user has not set NUMBA_CACHE_DIR.
    _here = Path(__file__).resolve().parents[1]
    _stamp = stamp(_here.parent)
    _kept = kept(_here / "__pycache__", _stamp) or kept(cache(), _stamp)
    config.CACHE_DIR = str(_kept or "")  # type: ignore[attr-defined]
