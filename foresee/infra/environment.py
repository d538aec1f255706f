"""The environment that results were made in: machine, packages, and commit of this code."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

DISTRIBUTION = "foresee-nav"
"""Name of this project on the package index, where `foresee` is another one."""


def own_version() -> str:
    """Return the version of this project that is installed."""
    return version(DISTRIBUTION)


def machine() -> dict[str, Any]:
    """Return processor, number of cores, system, and versions of Python and of packages."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        model = next(line.split(":", 1)[1].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        pass
    packages = ("numpy", "numba", "scipy", "casadi", "daqp", "ompl", "torch")
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in packages},
    }


@lru_cache(maxsize=1)
def commit() -> str | None:
    """Return the commit of this code, with "+" if files were changed since; None if git has none.

    A copy of the packages further down in another repository has no commit: that repository is the
    user's.
    """
    file = Path(__file__).resolve()
    root = file.parents[2]
    # A git hook of another repository sets these for all its children.
    hooks = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_PREFIX")
    environment = {name: value for name, value in os.environ.items() if name not in hooks}

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=root, env=environment, capture_output=True, check=True
        )
        return done.stdout.decode(errors="replace").strip()

    try:
        # The prefix is the path from the top of the work tree to `root`.
        if git("rev-parse", "--show-prefix"):
            return None
        git("ls-files", "--error-unmatch", str(file.relative_to(root)))
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "-uno") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def several_states(commits: Iterable[str | None], of: str) -> str:
    """Return a warning if results come from several states of the code, else "".

    Args:
        commits: commit of each result.
        of: word for the results in the warning, such as "drives".
    """
    count = len(set(commits))
    if count < 2:
        return ""
    return (
        f"warning: these {of} were made with {count} versions of the code; to make all with one, "
        "choose another --out"
    )
