"""Make samples to learn from: drive the car through generated buildings and look over its shoulder.

The car drives by its own planner, without prediction. Each drive is then seen again through LIDARs
of other windows and other noise, which costs a tenth of driving it.

    python -m predictor.drives                            truth is the building: to drive by
    python -m predictor.drives --logs --out data/logs     truth is what a robot's log maps of it
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.runs.settings import FAMILIES
from predictor.data.drives_config import MOST, DrivesConfig
from predictor.infra.command_line import OneLineParser, between, run_command


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    default = DrivesConfig()
    parser = OneLineParser(
        prog="predictor.drives",
        description="Make samples to train predictors on: drives of the project's own planner "
        "through generated buildings. Interrupted, it goes on where it was: give the same command.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=default.out, metavar="DIR",
        help="folder of the samples (default: %(default)s)")  # fmt: skip
    add(
        "--train",
        type=between(1, MOST),
        default=default.train,
        metavar="N",
        help="drives to learn from (default: %(default)s; one gives about 50 samples)",
    )
    add("--validation", type=between(1, MOST), default=default.validation, metavar="N",
        help="drives to tune on (default: %(default)s)")  # fmt: skip
    add("--logs", action="store_true", help="of simulated robots' logs instead, as real ones are "
        "made: 180°, scans up to a metre apart, people, and as truth the map of all the log's "
        "scans")  # fmt: skip
    add("--families", nargs="+", choices=FAMILIES, default=list(default.families), metavar="F",
        help=f"of the buildings, in turn (default: {' '.join(default.families)})")  # fmt: skip
    parser.add_jobs()
    return run_command("predictor.drives", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from benchmarks.recording.training_drives import make

    make(DrivesConfig(args.out, args.train, args.validation, logs=args.logs,
                      families=tuple(args.families)), args.jobs)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
