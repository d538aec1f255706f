"""Commands that analyse saved runs, and write what they find into one file."""

from __future__ import annotations

import argparse
from pathlib import Path
from pkgutil import resolve_name

from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.infra.environment import commit
from predictor.infra.results_file import COMMANDS, write_results


def analyse(kind: str, function: str, description: str, argv: list[str] | None) -> int:
    """Run the command line of an analysis; return its exit status.

    Args:
        kind: of its results; `benchmarks.tables` makes the table of this kind.
        function: "module:name" of what analyses a `Run`; imported when it is needed.
        description: for --help.
        argv: arguments; by default those of the process.
    """
    command = COMMANDS[kind]
    parser = OneLineParser(
        prog=command,
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
    add(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path(f"results/{kind}.json"),
        help="file of the results (default: %(default)s)",
    )
    return run_command(command, lambda: _run(kind, function, parser.parse_args(argv)))


def _run(kind: str, function: str, args: argparse.Namespace) -> None:
    from benchmarks.runs.saved_run import Run

    of_run, table = resolve_name(function), resolve_name(f"{function.partition(':')[0]}:table")
    runs = [Run.load(path).first(args.episodes) for path in args.runs]
    results = {"commit": commit(), "runs": [of_run(run) for run in runs]}
    write_results(args.out, kind, results)
    print(table(results), "", args.out, sep="\n")
