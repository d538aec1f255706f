"""Calibrate the last resort: find the largest level λ that is certified for each risk δ.

python -m benchmarks.calibrate --world corridor narrow office paper --risks 0.05 0.02
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from benchmarks.calibration.settings import CalibrateSettings
from benchmarks.runs.settings import CONDITIONS, Settings
from foresee.infra.command_line import OneLineParser, run_command

if TYPE_CHECKING:
    import argparse

COMMAND = "benchmarks.calibrate"
DRIVEN = ("world", "predictor", *CONDITIONS)
"""Fields of `benchmarks.runs.settings.Settings` that are also options of this command."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status: 0 if each risk has a certified level; 1 if one has none; 2 for bad input;
        130 if interrupted.
    """
    parser = OneLineParser(
        prog=COMMAND,
        description="Find the largest level λ at which the last resort may rely on predictions, so "
        "that the probability of a collision in a drive stays below a bound. The method is "
        "learn-then-test on drives at each level, from the safest level to the boldest. "
        "Interrupted, it continues when the same command is given again.",
    )
    CalibrateSettings.add_to(parser)
    Settings.add_to(parser, *DRIVEN)
    parser.add_jobs()
    parser.add_out("results/calibration", "folder of calibration.json and of the drives", "DIR")
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from benchmarks.calibration.learn_then_test import calibrate, table
    from sim.buildings import check_maps

    settings, asked = Settings.of(args, *DRIVEN), CalibrateSettings.of(args)
    check_maps(settings.world)
    found = calibrate(settings, asked, args.out, args.jobs)
    print(table(found), "", args.out / "calibration.json", sep="\n")
    return 0 if len(found["certified"]) == len(asked.risks) else 1


if __name__ == "__main__":
    sys.exit(main())
