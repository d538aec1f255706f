"""Interrupt the long commands at random moments, and compare the resumed results.

    python -m benchmarks.studies.robustness.interrupt --trials 480 --disk /mnt/small

Small runs of the commands corridor, drives, dataset, train, evaluate and study are interrupted by
SIGKILL, SIGTERM, Ctrl-C and a full disk. Each run is continued with the same command, and its
results are compared with those of an uninterrupted run. Interrupted, this command continues when it
is given again. Exit status: 1 if a trial failed.
"""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from benchmarks.runs.drive_file import DriveFile
from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, option

LATEST = 1.2
"""Latest moment of an interruption, as a multiple of the time of an uninterrupted run."""


@dataclass(frozen=True)
class InterruptSettings(Options):
    """Settings that decide the trials, except for the kinds of interruption."""

    trials: int = option(
        480, "number of trials; commands and kinds of interruption in turn", "N", low=1, high=10**9
    )
    seed: int = option(0, "seed of the interruption times", "N", low=0, high=2**31)
    commands: tuple[str, ...] = option(
        (), "commands to interrupt, such as predictor.drives (default: all)", "C"
    )


@dataclass(frozen=True)
class Place(Options):
    """Options of where the trials run; none of them changes a result."""

    disk: Path | None = option(
        None,
        "empty folder on a file system of its own of about 100 MB, which is filled up (mount -t "
        "tmpfs -o size=100m tmpfs DIR); without it, there are no trials with a full disk",
        "DIR",
    )
    jobs: int = option(
        1, "number of parallel trials; each uses 2 processes", "N", low=1, high=10_000
    )
    work: Path = option(
        Path("results/interrupt"),
        "folder of input data, uninterrupted runs, and files of failed trials",
        "DIR",
    )
    out: Path = option(Path("results/interrupt.json"), "file of the trials", "FILE")


def _run(settings: InterruptSettings, place: Place) -> int:
    # Imported here, so that --help does not wait for slow imports.
    import numpy as np

    from benchmarks.studies.robustness import interruptions
    from foresee.infra.environment import commit

    if place.disk is not None and not os.path.ismount(place.disk):
        raise UsageError(f"--disk: no file system of its own is mounted at {place.disk}")
    kinds = [kind for kind in interruptions.KINDS if kind != "disk full" or place.disk is not None]
    commands = settings.commands or list(interruptions.CASES)
    unknown = [name for name in commands if name not in interruptions.CASES]
    if unknown:
        raise UsageError(f"--commands: {unknown[0]} is none of {', '.join(interruptions.CASES)}")
    decisive = asdict(settings) | {"kinds": kinds, "commit": commit()}
    store = DriveFile(place.out, "interrupt", decisive, grows="trials")
    folder = place.work.absolute()
    seconds = interruptions.references(folder, commands)
    turns = [(command, kind) for kind in kinds for command in commands]
    shares = np.random.default_rng(settings.seed).uniform(0.0, LATEST, settings.trials).tolist()
    items = [(i, *turns[i % len(turns)], shares[i]) for i in range(settings.trials)]
    work = partial(interruptions.interrupted, folder, place.disk and place.disk.absolute(), seconds)
    store.fill(work, items, place.jobs, lambda t: f"{t['command']}, {t['kind']}", unit="trial")
    trials = store.first(settings.trials)
    print(interruptions.table({"drives": trials}), "", place.out, sep="\n")
    failed = [trial for trial in trials if not interruptions.good(trial)]
    for trial in failed:
        print(f"trial {trial['index']}, {trial['command']}, {trial['kind']}: {trial}")
    return 1 if failed else 0


main = Command("benchmarks.studies.robustness.interrupt", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
