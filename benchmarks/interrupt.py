"""Interrupt the long commands at random moments, and compare what they resume to.

python -m benchmarks.interrupt --trials 480 --disk /mnt/small
"""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.runs.drive_file import DriveFile
from predictor.infra.command_line import OneLineParser, UsageError, between, run_command
from predictor.infra.options import Options, option

if TYPE_CHECKING:
    import argparse

COMMAND = "benchmarks.interrupt"
LATEST = 1.2
"""Interruptions are drawn from 0 to this multiple of the time of an uninterrupted run."""


@dataclass(frozen=True)
class InterruptSettings(Options):
    """All that decides the trials, but for the kinds of interruption."""

    trials: int = option(
        480, "number of interruptions, over all commands and kinds in turn", "N", low=1, high=10**9
    )
    seed: int = option(0, "seed of the moments", "N", low=0, high=2**31)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 if a trial went wrong, 2 for bad input, 130 if interrupted."""
    parser = OneLineParser(
        prog=COMMAND,
        description="Interrupt small runs of the long commands (corridor, drives, dataset, train, "
        "evaluate, study) at random moments by SIGKILL, SIGTERM, Ctrl-C and a full disk. Run each "
        "again, and compare its results with those of an uninterrupted run. The command itself "
        "can be interrupted and continued.",
    )
    InterruptSettings.add_to(parser)
    add = parser.add_argument
    add(
        "--disk",
        type=Path,
        metavar="DIR",
        help="empty folder on a file system of its own with "
        "some 100 MB, which is filled up (mount -t tmpfs -o size=100m tmpfs DIR); without it no "
        "disk is filled",
    )
    add(
        "--jobs",
        type=between(1, 10_000),
        default=1,
        metavar="N",
        help="trials at a time; each uses 2 processes (default: %(default)s)",
    )
    add(
        "--work",
        type=Path,
        default=Path("results/interrupt"),
        metavar="DIR",
        help="data, uninterrupted runs, and what failed trials left (default: %(default)s)",
    )
    add(
        "--out",
        type=Path,
        default=Path("results/interrupt.json"),
        metavar="FILE",
        help="file of the trials (default: %(default)s)",
    )
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    import numpy as np

    from benchmarks.robustness.interruptions import (
        CASES,
        KINDS,
        good,
        interrupted,
        references,
        table,
    )
    from predictor.infra.environment import commit

    if args.disk is not None and not os.path.ismount(args.disk):
        raise UsageError(f"--disk: {args.disk} is no file system of its own")
    kinds = [kind for kind in KINDS if kind != "disk full" or args.disk is not None]
    settings = asdict(InterruptSettings.of(args)) | {"kinds": kinds, "commit": commit()}
    store = DriveFile(args.out, "interrupt", settings, grows="trials")
    folder = args.work.absolute()
    seconds = references(folder)
    turns = [(command, kind) for kind in kinds for command in CASES]
    shares = np.random.default_rng(args.seed).uniform(0.0, LATEST, args.trials).tolist()
    items = [(i, *turns[i % len(turns)], shares[i]) for i in range(args.trials)]
    work = partial(interrupted, folder, args.disk and args.disk.absolute(), seconds)
    store.fill(work, items, args.jobs, lambda trial: f"{trial['command']}, {trial['kind']}")
    trials = store.first(args.trials)
    print(table({"drives": trials}), "", args.out, sep="\n")
    bad = [trial for trial in trials if not good(trial)]
    for trial in bad:
        print(f"trial {trial['index']}, {trial['command']}, {trial['kind']}: {trial}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
