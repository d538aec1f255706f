"""The cache of compiled kernels: kept between runs, and compiled again when any of them changes.

Import `njit` from here, not from numba: this module says first where numba keeps what it compiles.

numba checks only a kernel's own file. A kernel that calls one of another file would go on using the
old code of that one, which is not acceptable in code that decides about collisions. So all kernels
are kept in a folder that is named after the sources of all: in the package, or in the user's cache
where the package cannot be written.
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
"""A folder that no process has used for this long is deleted [s]."""


def stamp(root: Path) -> str:
    """Return a hash of all kernels' sources under the folder that holds the packages."""
    digest = hashlib.sha256()
    for package in ("planner", "predictor", "sim"):
        for path in sorted((root / package).rglob("*.py")):
            source = path.read_bytes()
            if b"@njit" in source:
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()[:16]


def cache() -> Path:
    """Return the folder where compiled code is kept for a user."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "foresee"


def kept(place: Path, stamp: str) -> Path | None:
    """Return the folder of a stamp's kernels in a place, made if need be; None if it cannot be
    written.

    Those of other stamps go once they are `UNUSED`: by then no process that starts or runs beside
    this one has them in use.
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
    # Else the user has said by NUMBA_CACHE_DIR where.
    _here = Path(__file__).resolve().parents[1]
    _stamp = stamp(_here.parent)
    _kept = kept(_here / "__pycache__", _stamp) or kept(cache(), _stamp)
    config.CACHE_DIR = str(_kept or "")  # type: ignore[attr-defined]
