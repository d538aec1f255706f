"""Make samples to learn from: drive the car through generated buildings and look over its shoulder.

The car drives by its own planner, without prediction. Each drive is then seen again through LIDARs
of other windows and other noise, which costs a tenth of driving it.

    python -m predictor.drives                              truth is the building: to drive by
    python -m predictor.drives --logs 1 --out data/logs     truth is what a robot's log maps of it
"""

from __future__ import annotations

import argparse
import sys

from benchmarks.recording.settings import DrivesConfig
from predictor.infra.command_line import OneLineParser, run_command


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.drives",
        description="Make samples to train predictors on: drives of the project's own planner "
        "through generated buildings. Interrupted, it goes on where it was: give the same command.",
    )
    DrivesConfig.add_to(parser)
    parser.add_jobs()
    return run_command("predictor.drives", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from benchmarks.recording.training_drives import make

    make(DrivesConfig.of(args), args.jobs)


if __name__ == "__main__":
    sys.exit(main())
