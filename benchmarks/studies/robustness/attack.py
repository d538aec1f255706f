"""Drive with hostile predictors in all families of buildings; no car may collide.

python -m benchmarks.studies.robustness.attack --drives 400
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

from benchmarks.runs.drive_file import DriveFile
from foresee.infra.command_line import OneLineParser, run_command
from foresee.infra.options import Options, option

if TYPE_CHECKING:
    import argparse

COMMAND = "benchmarks.studies.robustness.attack"
SEED = 990_000
"""Seed of the first building; no network was trained in a building of such seeds."""


@dataclass(frozen=True)
class AttackSettings(Options):
    """Settings that decide the drives of an attack."""

    drives: int = option(100, "number of drives", "N", low=1, high=10**9)
    seed: int = option(SEED, "seed of the first building", "N", low=0, high=2**31)
    seconds: float = option(
        20.0, "longest duration of a drive, in simulated time [s]", "S", low=0.1, high=1e6
    )


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 after a collision or crash, 2 for bad input, 130 if interrupted."""
    parser = OneLineParser(
        prog=COMMAND,
        description="Drive with predictors that predict falsely, write into their arguments, "
        "answer late, raise and break the contract, at reliances from 0 to 0.99, and count "
        "collisions of the car and crashes of the program: there may be none. Interrupted, it "
        "continues when the same command is given again.",
    )
    AttackSettings.add_to(parser)
    parser.add_jobs()
    parser.add_out("results/attack.json", "file of the drives")
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from benchmarks.studies.robustness.hostile_drives import attacked, table

    store = DriveFile(args.out, "attack", asdict(AttackSettings.of(args)), grows="drives")
    work = partial(attacked, args.seed, args.seconds)
    store.fill(work, range(args.drives), args.jobs, lambda drive: str(drive["kind"]))
    drives = store.first(args.drives)
    print(table({"drives": drives}), "", args.out, sep="\n")
    bad = [d for d in drives if d["outcome"] in ("collided", "crashed")]
    for d in bad:
        print(f"drive {d['index']}, {d['kind']}: {d['outcome']} {d['error'] or ''}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
