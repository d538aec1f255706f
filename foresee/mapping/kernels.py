"""The cache of kernels compiled by numba: all are compiled again when any of them changes.

Import `njit` from here, not from numba: this module first sets the folder of numba's cache.

numba recompiles a kernel only when the kernel's own file changes. A kernel that calls a kernel of
another file would keep using that one's old code, which is not acceptable in code that decides
about collisions. The cache folder is therefore named after a hash of the sources of all kernels. It
lies in the package, or in the user's cache folder if the package cannot be written. If neither can
be written, each process compiles the kernels in memory.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import shutil
import time
from collections.abc import Iterator
from multiprocessing import parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba import config

from foresee.infra.cache_folder import cache_folder, is_writable

PACKAGES = ("foresee", "sim", "planner", "predictor", "benchmarks")
"""Packages that contain kernels."""
UNUSED = 7 * 86400.0
"""Time after which a cache folder that no process has used is deleted [s]."""


def stamp(root: Path) -> str:
    """Return a hash of the sources of all kernels.

    Args:
        root: folder that contains the packages.
    """
    digest = hashlib.sha256()
    for path, source in _sources(root):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()[:16]


def _sources(root: Path) -> Iterator[tuple[Path, bytes]]:
    """Yield the path and the source of each module with kernels."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            source = path.read_bytes()
            if b"@njit" in source:
                yield path, source


def kernel_count() -> int:
    """Return the number of kernels in all packages, of which one command uses most."""
    return sum(source.count(b"\n@njit") for _, source in _sources(_ROOT))


def warm_mark() -> Path | None:
    """Return the file that exists once the kernels are in the cache; None: there is no cache."""
    if not _FOLDER:
        return None
    return Path(_FOLDER) / f"warm-{stamp(_ROOT)}-{numba.__version__}"


def kept(place: Path, stamp: str) -> Path | None:
    """Make the cache folder of a stamp, and return it; None if it cannot be written.

    Folders of other stamps are deleted once they have not been used for `UNUSED`, so that running
    processes keep theirs.

    Args:
        place: parent folder.
        stamp: hash of the kernels' sources.
    """
    folder = place / f"kernels-{stamp}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    for other in place.glob("kernels-*"):
        # Another process may be removing it too.
        with contextlib.suppress(OSError):
            if other.stat().st_mtime < time.time() - UNUSED:
                shutil.rmtree(other)
    return folder


if TYPE_CHECKING:
    from numba import njit as njit
else:

    def njit(*args: Any, cache: bool = False, **options: Any) -> Any:
        """Compile a function as `numba.njit` does; without a cache folder, it is not cached."""
        return numba.njit(*args, cache=cache and bool(_FOLDER), **options)


_ROOT = Path(__file__).resolve().parents[2]


def _folder() -> str:
    """Return the folder of numba's cache; "" if none can be written."""
    given = str(config.CACHE_DIR)  # type: ignore[attr-defined]
    # The user has set NUMBA_CACHE_DIR.
    if given and is_writable(Path(given)):
        return given
    here = _ROOT / "foresee"
    version, user = stamp(_ROOT), cache_folder()
    folder = kept(here / "__pycache__", version) or (user and kept(user, version))
    if folder is None and parent_process() is None:
        logging.getLogger(__name__).warning(
            "no cache folder can be written: each process compiles for about a minute; set "
            "XDG_CACHE_HOME to a folder that can be written"
        )
    return str(folder or "")


config.CACHE_DIR = _FOLDER = _folder()  # type: ignore[attr-defined]
