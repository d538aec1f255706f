"""Make the data sets of the prediction study: the paper's simulated one, and those of real logs.

    python -m predictor.dataset                                    simulated, with more test drives
    python -m predictor.dataset --log intel.log.gz aces.log.gz     from logs of real robots

docs/reference/files.md describes their contents; `predictor.data.frames.Frames` reads them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path

from foresee.infra.command_line import OneLineParser, UsageError, run_command
from predictor.data import LOG_FORMATS, PHYSICAL, SIMULATED
from predictor.recording.settings import SimulatedConfig


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("predictor.dataset", lambda: _run(_parsed(argv)))


def _parsed(argv: list[str] | None) -> argparse.Namespace:
    parser = OneLineParser(
        prog="predictor.dataset",
        description="Make a data set as that of Katyal et al. 2018: for each tick of a drive, what "
        "the LIDAR has observed around the car, and the true map there. Without --log the drives "
        "are simulated, six in two buildings and more in others; with --log they are logs of real "
        "robots. Interrupted, it continues when the same command is given again.",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"folder of the set (default: {SIMULATED}, with --log {PHYSICAL})",
    )
    parser.add_jobs()
    SimulatedConfig.add_to(parser.add_argument_group("simulated; by default as the paper's set"))
    physical = parser.add_argument_group("physical")
    add = physical.add_argument
    add(
        "--log",
        nargs="+",
        type=Path,
        metavar="PATH",
        help=f"logs with corrected poses, or folders of them: {LOG_FORMATS}",
    )
    add("--scans", metavar="TOPIC", help="topic of a bag's LaserScans (default: the only one)")
    add(
        "--poses",
        metavar="TOPIC",
        help="topic of a bag's poses: /tf, PoseStamped, "
        "PoseWithCovarianceStamped or Odometry (default: /tf where it knows the map, else the only "
        "topic of poses)",
    )
    add(
        "--map-frame",
        default="map",
        metavar="FRAME",
        help="map frame in /tf (default: %(default)s)",
    )
    args = parser.parse_args(argv)
    _check(args, parser)
    return args


def _check(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Refuse options that do not belong to the kind of data set that is made.

    Raises:
        UsageError: if there is one.
    """
    simulated = [field.name for field in fields(SimulatedConfig)]
    others = simulated if args.log else ["scans", "poses", "map_frame"]
    for name in others:
        if getattr(args, name) != parser.get_default(name):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} {'cannot be given with' if args.log else 'needs'} --log")


def _run(args: argparse.Namespace) -> None:
    from predictor.data.bags import BagConfig
    from predictor.data.log_files import logs_in
    from predictor.recording.data_sets import make_physical, make_simulated

    folder = args.out or (PHYSICAL if args.log else SIMULATED)
    if args.log:
        topics = BagConfig(args.scans, args.poses, args.map_frame)
        make_physical(folder, logs_in(args.log), topics, args.jobs)
    else:
        make_simulated(folder, SimulatedConfig.of(args), args.jobs)
    print(folder)


if __name__ == "__main__":
    sys.exit(main())
