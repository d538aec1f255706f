"""What the analyses of saved runs have in common: stuck, sweeps and weave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.environment import commit
from foresee.infra.options import Options, argument, option
from foresee.infra.results_file import write_results

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run


@dataclass(frozen=True)
class RunsSettings(Options):
    """Saved runs that are analysed."""

    runs: tuple[Path, ...] = argument("folder of a run of benchmarks.corridor", "DIR")
    episodes: int | None = option(
        None, "analyse only the first N episodes of each run (default: all)", "N", low=1
    )


def analyse(
    kind: str,
    settings: RunsSettings,
    out: Path,
    analysis: Callable[[Run], dict[str, Any]],
    table: Callable[[dict[str, Any]], str],
) -> None:
    """Analyse saved runs, write the results, and print them as a table.

    Args:
        kind: kind of the results, a key of `foresee.infra.results_file.COMMANDS`.
        settings: runs and number of episodes.
        out: path of the results file.
        analysis: function that analyses a run.
        table: function that turns the contents of the results file into Markdown.
    """
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.runs.saved_run import Run

    runs = [Run.load(path) for path in settings.runs]
    if settings.episodes is not None:
        runs = [run.first(settings.episodes) for run in runs]
    entries = [{"label": run.label, "settings": run.settings, **analysis(run)} for run in runs]
    results = {"commit": commit(), "runs": entries}
    write_results(out, kind, results)
    print(table(results), "", out, sep="\n")
