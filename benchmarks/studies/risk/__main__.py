"""Measure how the realised risk of a collision compares with the requested one, and with speed.

The series of drives are listed in `benchmarks.studies.risk.series`.

python -m benchmarks.studies.risk --calibration results/calibration/calibration.json --hours 2
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from foresee.infra.command_line import OneLineParser, between, run_command

if TYPE_CHECKING:
    from benchmarks.studies.risk.series import Series
    from planner.risk.calibration import Calibration

COMMAND = "benchmarks.studies.risk"


def main(argv: list[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status: 0 if no accepted risk was exceeded; 1 if a car collided with or touched
        something at a risk of 0, or if the whole interval of the realised risk lies above the
        requested risk in buildings like those of a calibration; 2 for bad input; 130 if
        interrupted.
    """
    parser = OneLineParser(
        prog=COMMAND,
        description="Drive at each risk that a calibration certifies, in buildings that were not "
        "used for it; compare the requested risk with the share of collisions, and that with the "
        "speed. Interrupted, it continues when the same command is given again.",
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        nargs="+",
        required=True,
        help="calibration.json of benchmarks.calibrate. The whole study is about the first; "
        "further ones, such as one for each family, are tested in buildings like their own",
    )
    parser.add_argument(
        "--predictor",
        metavar="P",
        default="compact",
        help="predictor that the calibrations were made for (default: %(default)s)",
    )
    parser.add_argument(
        "--rivals",
        metavar="P",
        nargs="+",
        default=[],
        help="other predictors to compare with, besides extend, such as weights FILE.safetensors "
        "of the paper's networks",
    )
    parser.add_argument(
        "--maps",
        metavar="W",
        nargs="+",
        default=[],
        help="map_server .yaml files, or folders of them: real buildings to drive in as well",
    )
    parser.add_argument(
        "--runs",
        metavar="DIR",
        nargs="+",
        type=Path,
        default=[],
        help="folders of benchmarks.corridor, driven at a risk of 0: their drives are tested for "
        "contacts and counted as well",
    )
    parser.add_argument(
        "--hours",
        metavar="H",
        type=between(0.0, 1e4),
        default=4.0,
        help="longest run time [h]; all series of drives grow in turn (default: %(default)s)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="make only 4 drives of each series, as a trial"
    )
    parser.add_jobs()
    parser.add_out("results/risk", "folder of results.json, the figures and the drives", "DIR")
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from benchmarks.calibration.certificate import ABSENT, load_calibration
    from benchmarks.studies.risk.series import series_of
    from foresee.infra.resumable import ResumableFolder
    from sim.buildings import check_maps

    calibration, *others = (load_calibration(path) for path in args.calibration)
    check_maps(tuple(args.maps))
    all_series = series_of(calibration, others, args.predictor, args.rivals, args.maps, args.quick)
    told = calibration.conditions | {"quick": args.quick}
    with ResumableFolder(args.out, told, absent=ABSENT, exclusive=True):
        return _study(args, calibration, all_series)


def _study(args: argparse.Namespace, calibration: Calibration, all_series: list[Series]) -> int:
    from benchmarks.studies.risk.drives import drive_all
    from benchmarks.studies.risk.figures import draw
    from benchmarks.studies.risk.recalibration import recalibrations
    from benchmarks.studies.risk.report import (
        collision_rows,
        exceeds_its_risk,
        pooled_rows,
        speed_rows,
    )
    from benchmarks.studies.risk.saved_drives import saved_drives
    from benchmarks.studies.risk.tables import tables
    from foresee.infra.environment import commit, machine
    from foresee.infra.results_file import write_results

    saved_series, saved = saved_drives(args.runs)
    drives, missing = drive_all(all_series, args.out / "drives", args.hours, args.jobs)
    rows = collision_rows([*all_series, *saved_series], drives | saved, calibration.levels)
    found = {
        "calibration": {
            "conditions": calibration.conditions,
            "certified": {f"{risk:g}": level for risk, level in calibration.levels.items()},
            "confidence": calibration.confidence,
        },
        "machine": machine(),
        "commit": commit(),
        "missing": missing,
        "promise": rows,
        "pareto": speed_rows(all_series, drives),
        "pooled": pooled_rows(all_series, drives),
        "recalibrations": recalibrations(
            all_series, drives, args.predictor, calibration.confidence
        ),
    }
    write_results(args.out / "results.json", "risk", found)
    print("", tables(found), "", sep="\n")
    for path in [*draw(found, args.out), args.out / "results.json"]:
        print(path)
    for row in rows:
        if row["learned"]:
            print(
                f"warning: {row['series']}: the predictor was trained in buildings of "
                f"{row['learned']} drives"
            )
    exceeded = [row for row in rows if exceeds_its_risk(row)]
    for row in exceeded:
        print(f"more collisions than were accepted: {row['group']}, {row['series']}")
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
