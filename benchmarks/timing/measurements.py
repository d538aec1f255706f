"""Measurements that are kept on disk, so that an interrupted command continues."""

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

from predictor.infra.environment import machine
from predictor.infra.resumable import ResumableFolder

PACKAGES = ("benchmarks", "planner", "predictor", "sim")
RUNTIME = "openvino"
"""Runs networks where it is installed."""


@dataclass(frozen=True)
class Measurement:
    """Something to measure.

    Attributes:
        name: group/name, unique in a run.
        settings: all that decides what is measured, but for code and machine.
        measure: does it; what it returns must be fit for JSON.
    """

    name: str
    settings: dict[str, Any]
    measure: Callable[[], Any]


class KeptMeasurements:
    """A folder of measurements.

    What was measured by other code, on another machine, with other packages or with other settings
    counts as missing.

    Args:
        folder: where; made if need be.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = ResumableFolder(folder)

    def find(self, one: Measurement) -> Any:
        """Return what was measured, or None."""
        kept = self._folder.read(_file(one))
        return kept[0]["measured"] if kept is not None and kept[0].get("of") == _of(one) else None

    def measure(self, one: Measurement) -> Any:
        """Measure, and keep the result."""
        measured = one.measure()
        self._folder.write(_file(one), {"of": _of(one), "measured": measured}, {})
        return measured


def _file(one: Measurement) -> str:
    return "".join(c if c.isalnum() else "-" for c in one.name) + ".npz"


def _of(one: Measurement) -> dict[str, Any]:
    """Return what a measurement is of, as JSON gives it back."""
    of = {
        "name": one.name,
        "code": code(),
        "machine": machine(),
        "runtime": installed([RUNTIME]),
        "settings": one.settings,
    }
    plain: dict[str, Any] = json.loads(json.dumps(of))
    return plain


def installed(packages: Iterable[str]) -> dict[str, str]:
    """Versions of those packages that are installed, by name."""
    found = {}
    for package in packages:
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


@lru_cache(maxsize=1)
def code() -> str:
    """Return a fingerprint of this project's code and weights, committed or not."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".safetensors"):
                name = path.relative_to(root).as_posix()
                digest.update(f"{name}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:16]
