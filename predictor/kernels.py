"""Compiled kernels are kept between runs, and made anew when any of them changes.

numba stamps what it keeps of a kernel with the kernel's own file alone. A kernel that calls one of
another file would go on with that one's old code, and what decides over collisions must not.
So all are kept in a folder that is named after the sources of all.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from numba import config


def stamp(root: Path) -> str:
    """A hash of all kernels' sources under a folder with our packages."""
    digest = hashlib.sha256()
    for package in ("planner", "predictor", "sim"):
        for path in sorted((root / package).rglob("*.py")):
            source = path.read_bytes()
            if b"@njit" in source:
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()[:16]


if not config.CACHE_DIR:  # type: ignore[attr-defined]
    # Else the user has said by NUMBA_CACHE_DIR where.
    _here = Path(__file__).resolve().parent
    _kept = _here / "__pycache__" / f"kernels-{stamp(_here.parent)}"
    config.CACHE_DIR = str(_kept)  # type: ignore[attr-defined]
