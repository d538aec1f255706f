"""Files of results: JSON objects that say what `kind` they are."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from predictor.infra.atomic_file import write_whole
from predictor.infra.command_line import UsageError
from predictor.infra.errors import one_line
from predictor.infra.plain_json import loads

COMMANDS = {
    "comparison": "benchmarks.corridor",
    "optimum": "benchmarks.optimum",
    "attack": "benchmarks.attack",
    "interrupt": "benchmarks.interrupt",
    "stuck": "benchmarks.stuck",
    "weave": "benchmarks.weave",
    "sweeps": "benchmarks.sweeps",
    "stages": "benchmarks.stages",
    "prediction": "benchmarks.prediction",
    "evaluation": "predictor.evaluate",
    "calibration": "benchmarks.calibrate",
    "risk": "benchmarks.risk",
    "calibration drives": "benchmarks.calibrate",
    "risk drives": "benchmarks.risk",
}
"""The command that writes each kind of results."""


def write_results(path: Path, kind: str, results: Mapping[str, Any]) -> None:
    """Write a file of results, whole or not at all; its folder is made if it is missing.

    Args:
        path: of the file.
        kind: of `COMMANDS`.
        results: fit for JSON.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({"kind": kind, **results}, indent=1).encode())


def read_results(path: Path) -> dict[str, Any]:
    """Read a file of results, of any of `COMMANDS`.

    Raises:
        UsageError: if it cannot be read, or does not say what kind it is.
    """
    try:
        results = dict(loads(path.read_text()))
    except (OSError, ValueError, TypeError) as error:
        raise UsageError(f"{path} is no results file: {one_line(error)}") from None
    if "kind" not in results:
        raise UsageError(
            f"{path} does not say what kind of results it holds: add "
            f'"kind" at its beginning, one of {", ".join(COMMANDS)}, or run its command again'
        )
    if results["kind"] not in COMMANDS:
        raise UsageError(f"{path} is no results file: no kind is called {results['kind']!r}")
    return results
