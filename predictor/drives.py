"""Make training samples for the compact network on simulated drives through buildings.

The car drives with the project's own planner, without prediction. Each drive is then replayed with
LIDARs of other windows and other noise, which takes a tenth of the time of driving.

    python -m predictor.drives                        the truth is the whole building
    python -m predictor.drives --simulated-logs 1     the truth is the map of a simulated log
"""

from __future__ import annotations

import argparse
import sys

from foresee.infra.command_line import OneLineParser, run_command
from predictor.recording.settings import DrivesConfig


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.drives",
        description="Make samples to train predictors on: drives of the project's own planner "
        "through generated buildings. Interrupted, it continues when the same command is given "
        "again.",
    )
    DrivesConfig.add_to(parser)
    parser.add_jobs()
    return run_command("predictor.drives", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from predictor.recording.training_drives import make

    make(DrivesConfig.of(args), args.jobs)


if __name__ == "__main__":
    sys.exit(main())
