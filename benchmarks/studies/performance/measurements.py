"""Measurements that are stored in a folder, so that an interrupted command can continue."""

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
from foresee.infra.resumable import ResumableFolder

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


class KeptMeasurements:
    """A folder of finished measurements.

    A measurement by other code, on another machine, with other packages or with other settings
    counts as missing.

    Args:
        folder: folder; made if it is missing.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = ResumableFolder(folder)

    def find(self, one: Measurement) -> Any:
        """Return the stored result of a measurement; None if there is none."""
        kept = self._folder.read(_file(one))
        return kept[0]["measured"] if kept is not None and kept[0].get("of") == _of(one) else None

    def measure(self, one: Measurement) -> Any:
        """Measure, store the result, and return it."""
        measured = one.measure()
        self._folder.write(_file(one), {"of": _of(one), "measured": measured}, {})
        return measured


def _file(one: Measurement) -> str:
    return "".join(c if c.isalnum() else "-" for c in one.name) + ".npz"


def _of(one: Measurement) -> dict[str, Any]:
    """Return all that identifies a measurement, converted to JSON and back for comparisons."""
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
    """Return package → version for those of some packages that are installed."""
    found = {}
    for package in packages:
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


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
