"""Measurements, and the names under which they are stored."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from foresee.infra.environment import machine

PACKAGES = ("benchmarks", "foresee", "planner", "predictor", "sim")
RUNTIME = "openvino"
"""Package that runs networks if it is installed."""


@dataclass(frozen=True)
class Measurement:
    """One measurement.

    Attributes:
        name: name, group/name, unique in a run.
        settings: all that decides the measurement, except for code, machine and packages.
        measure: function that measures and returns plain data for JSON.
    """

    name: str
    settings: dict[str, Any]
    measure: Callable[[], Any]

    @property
    def file(self) -> str:
        """Name of its file.

        It contains a hash of all that decides the measurement, so that measurements by other code,
        on another machine, with other packages or with other settings are repeated.
        """
        decisive = [self.name, self.settings, code(), machine(), installed([RUNTIME])]
        digest = hashlib.sha256(json.dumps(decisive).encode()).hexdigest()
        words = "".join(c if c.isalnum() else "-" for c in self.name)
        return f"{words}-{digest[:16]}.json"


def installed(packages: Iterable[str]) -> dict[str, str]:
    """Return package → version for those of some packages that are installed."""
    versions = {}
    for package in packages:
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


@lru_cache(maxsize=1)
def code() -> str:
    """Return a fingerprint of this project's code and weights, committed or not."""
    root = Path(__file__).resolve().parents[3]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".safetensors"):
                name = path.relative_to(root).as_posix()
                digest.update(f"{name}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:16]
