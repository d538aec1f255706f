"""What the analyses of saved runs have in common: stuck, sweeps and weave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.command_line import Command
from foresee.infra.environment import commit
from foresee.infra.options import Options, argument, option
from foresee.infra.results_file import COMMANDS, write_results

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run


@dataclass(frozen=True)
class RunsSettings(Options):
    """Saved runs that are analysed, and the file of the results."""

    runs: tuple[Path, ...] = argument("folder of a run of benchmarks.corridor", "DIR")
    episodes: int | None = option(
        None, "analyse only the first N episodes of each run (default: all)", "N", low=1
    )
    out: Path | None = option(
        None, "file of the results (default: results/NAME.json, with the command's name)", "FILE"
    )


def command(
    kind: str,
    description: str | None,
    analysis: Callable[[Run], dict[str, Any]],
    table: Callable[[dict[str, Any]], str],
) -> Command:
    """Return a command that analyses saved runs, writes the results, and prints them as a table.

    Args:
        kind: kind of the results, a key of `foresee.infra.results_file.COMMANDS`.
        description: text of the help.
        analysis: function that analyses a run.
        table: function that turns the contents of the results file into Markdown.
    """

    def run(settings: RunsSettings) -> None:
        # Imported here, so that --help and bad arguments do not wait for slow imports.
        from benchmarks.runs.saved_run import Run

        out = settings.out or Path("results") / f"{kind}.json"
        runs = [Run.load(path) for path in settings.runs]
        if settings.episodes is not None:
            runs = [run.first(settings.episodes) for run in runs]
        entries = [{"label": run.label, "settings": run.settings, **analysis(run)} for run in runs]
        results = {"commit": commit(), "runs": entries}
        write_results(out, kind, results)
        print(table(results), "", out, sep="\n")

    return Command(COMMANDS[kind], description, run, resumes=False)
