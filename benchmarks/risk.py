"""The study of the risk dial: is the promise kept, and what speed does a risk buy?

python -m benchmarks.risk --calibration results/calibration/calibration.json --hours 2
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from predictor.infra.command_line import OneLineParser, between, run_command

if TYPE_CHECKING:
    from benchmarks.risk_study.cells import Cell
    from planner.risk.calibration import Calibration

COMMAND = "benchmarks.risk"


def main(argv: list[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status: 0; 1 if a car has collided, or touched something, at a risk of 0, or if
        the interval of the realised risk of the mixture lies above the requested one; 2 for bad
        input; 130 if interrupted.
    """
    parser = OneLineParser(
        prog=COMMAND,
        description="Drive at each risk that a calibration certifies, in buildings that it has not "
        "seen, and compare the risk that was requested with the collisions, and the collisions "
        "with the speed. Interrupted studies go on: give the same command again.",
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        required=True,
        help="calibration.json of benchmarks.calibrate",
    )
    parser.add_argument(
        "--predictor",
        metavar="P",
        default="compact",
        help="the predictor that the calibration is for (default: %(default)s)",
    )
    parser.add_argument(
        "--maps",
        metavar="W",
        nargs="+",
        default=[],
        help="map_server .yaml files, or folders of them, of real buildings to drive in too",
    )
    parser.add_argument(
        "--runs",
        metavar="DIR",
        nargs="+",
        type=Path,
        default=[],
        help="runs of benchmarks.corridor at a risk of 0, whose drives are tested and counted too",
    )
    parser.add_argument(
        "--hours",
        metavar="H",
        type=between(0.0, 1e4),
        default=4.0,
        help="time that it may take [h]; the cells grow in turns (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="4 drives of each cell")
    parser.add_jobs()
    parser.add_out("results/risk", "folder of results.json, the figures and the drives", "DIR")
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from benchmarks.risk_study.cells import cells_of
    from benchmarks.runs.drive import check_maps
    from planner.risk.calibration import Calibration
    from predictor.infra.resumable import ResumableFolder

    calibration = Calibration.load(args.calibration)
    check_maps(tuple(args.maps))
    cells = cells_of(calibration, args.predictor, args.maps, args.quick)
    told = calibration.conditions | {"quick": args.quick}
    with ResumableFolder(args.out, told, exclusive=True):
        return _study(args, calibration, cells)


def _study(args: argparse.Namespace, calibration: Calibration, cells: list[Cell]) -> int:
    from benchmarks.risk_study.drives import drive_all
    from benchmarks.risk_study.figures import draw
    from benchmarks.risk_study.recalibration import recalibrations
    from benchmarks.risk_study.report import comparisons, is_broken, promises
    from benchmarks.risk_study.saved_drives import saved_drives
    from benchmarks.risk_study.tables import tables
    from predictor.infra.environment import commit, machine
    from predictor.infra.results_file import write_results

    saved_cells, saved = saved_drives(args.runs)
    drives, missing = drive_all(cells, args.out / "drives", args.hours, args.jobs)
    promise = promises([*cells, *saved_cells], drives | saved, calibration.levels)
    found = {
        "calibration": {
            "conditions": calibration.conditions,
            "certified": {f"{risk:g}": level for risk, level in calibration.levels.items()},
            "confidence": calibration.confidence,
        },
        "machine": machine(),
        "commit": commit(),
        "missing": missing,
        "promise": promise,
        "pareto": comparisons(cells, drives),
        "recalibrations": recalibrations(cells, drives, args.predictor, calibration.confidence),
    }
    write_results(args.out / "results.json", "risk", found)
    print("", tables(found), "", sep="\n")
    for path in [*draw(found, args.out), args.out / "results.json"]:
        print(path)
    for row in promise:
        if row["learned"]:
            print(
                f"warning: {row['cell']}: the predictor was trained in buildings of "
                f"{row['learned']} drives"
            )
    broken = [row for row in promise if is_broken(row)]
    for row in broken:
        print(f"the promise was broken: {row['group']}, {row['cell']}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
