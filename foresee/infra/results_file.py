"""Results files: JSON objects whose entry `kind` names the kind of results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from foresee.infra.atomic_file import write_whole
from foresee.infra.command_line import UsageError
from foresee.infra.errors import one_line
from foresee.infra.plain_json import read_object

COMMANDS = {
    "comparison": "benchmarks.corridor",
    "optimum": "benchmarks.optimum",
    "attack": "benchmarks.studies.robustness.attack",
    "errors": "benchmarks.studies.robustness.errors",
    "interrupt": "benchmarks.studies.robustness.interrupt",
    "stuck": "benchmarks.studies.driver.stuck",
    "weave": "benchmarks.studies.driver.weave",
    "sweeps": "benchmarks.studies.driver.sweeps",
    "stages": "benchmarks.studies.performance",
    "prediction": "benchmarks.studies.katyal2018",
    "evaluation": "predictor.evaluate",
    "calibration": "benchmarks.calibrate",
    "risk": "benchmarks.studies.risk",
    "calibration drives": "benchmarks.calibrate",
    "risk drives": "benchmarks.studies.risk",
    "worth": "benchmarks.studies.worth",
    "worth drives": "benchmarks.studies.worth",
    "buildings": "benchmarks.studies.buildings",
    "race": "benchmarks.bench",
}
"""Kind of results → command that writes it."""
MOST_BYTES = 4 * 10**8
"""Largest results file that is read [bytes]: that of some 400 000 drives."""


def write_results(path: Path, kind: str, results: Mapping[str, Any]) -> None:
    """Write a results file atomically; its folder is made if it is missing.

    Args:
        path: path of the file.
        kind: kind of the results, a key of `COMMANDS`.
        results: results, plain data for JSON.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({"kind": kind, **results}, indent=1).encode())


def read_results(path: Path) -> dict[str, Any]:
    """Read a results file of any kind in `COMMANDS`.

    Raises:
        UsageError: if it cannot be read, or has no entry `kind`, or an unknown one.
    """
    try:
        results = read_object(path, MOST_BYTES)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} is no results file: {one_line(error)}") from None
    if "kind" not in results:
        raise UsageError(
            f"{path} does not say what kind of results it holds: add "
            f'"kind" at its beginning, one of {", ".join(COMMANDS)}, or run its command again'
        )
    if not isinstance(results["kind"], str) or results["kind"] not in COMMANDS:
        raise UsageError(f"{path} is no results file: no kind is called {results['kind']!r}")
    return results
