"""Print the tables of results files as Markdown; the published tables take their numbers from it.

foresee tables docs/results/*.json
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from foresee.infra.command_line import Command, UsageError
from foresee.infra.errors import one_line
from foresee.infra.options import Options, argument, option
from foresee.infra.results_file import COMMANDS, read_results

TABLES = {
    "comparison": "benchmarks.runs.summary_text:comparison",
    "optimum": "benchmarks.runs.time_optimal:table",
    "attack": "benchmarks.studies.robustness.hostile_drives:table",
    "errors": "benchmarks.studies.robustness.error_tables:tables",
    "interrupt": "benchmarks.studies.robustness.interruptions:table",
    "stuck": "benchmarks.studies.driver.stuck:table",
    "weave": "benchmarks.studies.driver.weave:table",
    "sweeps": "benchmarks.studies.driver.sweeps:table",
    "stages": "benchmarks.studies.performance.tables:tables",
    "prediction": "benchmarks.studies.katyal2018.tables:study_tables",
    "evaluation": "predictor.evaluation.drive_scores:table",
    "calibration": "benchmarks.calibration.learn_then_test:table",
    "risk": "benchmarks.studies.risk.tables:tables",
    "calibration drives": "benchmarks.calibration.learn_then_test:table_of_drives",
    "risk drives": "benchmarks.runs.drive_file:table_of_outcomes",
    "worth": "benchmarks.studies.worth.tables:tables",
    "worth drives": "benchmarks.runs.drive_file:table_of_outcomes",
    "buildings": "benchmarks.studies.buildings:table",
    "race": "benchmarks.runs.drive_file:table_of_outcomes",
}
"""Kind of results → function that makes its tables; imported when it is needed."""


@dataclass(frozen=True)
class TableSettings(Options):
    """Which tables are printed."""

    files: tuple[Path, ...] = argument(
        f"results of {', '.join(dict.fromkeys(COMMANDS.values()))}", "FILE"
    )
    overview: bool = option(False, "print only one table, with a line for each comparison")


def file_tables(results: dict[str, Any]) -> str:
    """Return the tables of the contents of one results file as Markdown."""
    return str(resolve_name(TABLES[results["kind"]])(results))


def _run(settings: TableSettings) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.calibration.together import together
    from benchmarks.runs.overview import overview, reliances, scores

    files = [(name, _read(path)) for path, name in _names(settings.files).items()]
    comparisons = {name: of for name, of in files if of["kind"] == "comparison"}
    relied = {name: of for name, of in comparisons.items() if "predicted" in of["summary"]}
    runs = {name: of for name, of in comparisons.items() if "known" in of["summary"]}
    scored = {name: of for name, of in files if of["kind"] == "evaluation"}
    if settings.overview:
        if not runs:
            raise UsageError("--overview: no file has drives of known")
        print(overview(runs))
        return
    parts = [f"## {name}\n\n{of['tables']}\n" for name, of in files]
    with _broken_refused("one of these files"):
        calibrations = together({name: of for name, of in files if of["kind"] == "calibration"})
        if calibrations:
            parts.insert(0, f"## Calibrations together\n\n{calibrations}\n")
        if scored:
            parts.insert(0, f"## Scores\n\n{scores(scored)}\n")
        if len(relied) > 1:
            parts.insert(0, f"## Reliances\n\n{reliances(relied)}\n")
        if len(runs) > 1:
            parts.insert(0, f"## Overview\n\n{overview(runs)}\n")
    print("\n".join(parts), end="")


def _names(paths: Iterable[Path]) -> dict[Path, str]:
    """Return a name for each file: its stem, with its folder or whole path if two would be equal.

    A file that is given twice is named once.
    """
    once = dict[str, Path]()
    for path in paths:
        once.setdefault(os.path.realpath(path), path)
    files = once.values()
    stems = Counter(path.stem for path in files)
    places = Counter(_in_folder(path) for path in files)
    names = {}
    for path in files:
        names[path] = path.stem
        if stems[path.stem] > 1:
            names[path] = _in_folder(path) if places[_in_folder(path)] == 1 else str(path)
    return names


def _in_folder(path: Path) -> str:
    return f"{path.absolute().parent.name}/{path.stem}"


def _read(path: Path) -> dict[str, Any]:
    """Read a results file, and add its tables under `tables`."""
    from benchmarks.runs.overview import summarised

    results = read_results(path)
    with _broken_refused(str(path)):
        if results["kind"] == "comparison":
            results = summarised(results)
        return results | {"tables": file_tables(results)}


@contextmanager
def _broken_refused(where: str) -> Iterator[None]:
    """Raise UsageError if the results of a file are not what its kind promises."""
    try:
        yield
    except ImportError:
        raise UsageError(f"{where}: the study that makes its tables is not installed") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise UsageError(f"{where} is no results file: {one_line(error)}") from None


main = Command("benchmarks.tables", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
