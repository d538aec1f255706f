"""The common command line of commands that analyse saved runs: stuck, sweeps and weave."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.command_line import OneLineParser, between, run_command
from foresee.infra.environment import commit
from foresee.infra.results_file import COMMANDS, write_results

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run


def analyse(
    kind: str,
    of_run: Callable[[Run], dict[str, Any]],
    table: Callable[[dict[str, Any]], str],
    description: str,
    argv: list[str] | None,
) -> int:
    """Run the command line of an analysis, write its results, and return its exit status.

    Args:
        kind: kind of the results, a key of `foresee.infra.results_file.COMMANDS`.
        of_run: function that analyses a run.
        table: function that turns the contents of the results file into Markdown.
        description: description for --help.
        argv: command-line arguments; None: those of the process.
    """
    parser = OneLineParser(
        prog=COMMANDS[kind],
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("runs", metavar="DIR", nargs="+", type=Path, help="folder of a run of benchmarks.corridor")
    add(
        "--episodes",
        metavar="N",
        type=between(1, 10**9),
        default=10**9,
        help="analyse only the first N episodes of each run (default: all)",
    )
    parser.add_out(f"results/{kind}.json", "file of the results")

    def work() -> None:
        args = parser.parse_args(argv)
        # Imported here, so that --help and bad arguments do not wait for slow imports.
        from benchmarks.runs.saved_run import Run

        runs = [Run.load(path).first(args.episodes) for path in args.runs]
        found = [{"label": run.label, "settings": run.settings, **of_run(run)} for run in runs]
        results = {"commit": commit(), "runs": found}
        write_results(args.out, kind, results)
        print(table(results), "", args.out, sep="\n")

    return run_command(COMMANDS[kind], work)
