"""Measure how the realised risk of a collision compares with the requested one, and with speed.

    python -m benchmarks.studies.risk --calibration results/calibration/calibration.json --hours 2

The cars drive at each risk that a calibration certifies, in buildings that were not used for it.
The requested risk is compared with the share of collisions, and that with the speed. The series of
drives are listed in `benchmarks.studies.risk.series`. Interrupted, it continues when the same
command is given again. Exit status: 1 if a car collided with or touched something at a risk of 0,
or if the whole interval of the realised risk lies above the requested risk in buildings like those
of a calibration.
"""

from __future__ import annotations

import sys
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from foresee.infra.command_line import Command
from foresee.infra.options import Options, jobs_option, option

if TYPE_CHECKING:
    from benchmarks.studies.risk.series import Series
    from planner.risk.calibration import Calibration


@dataclass(frozen=True)
class RiskSettings(Options):
    """What is driven, for how long, and where the results are written."""

    calibration: tuple[Path, ...] = option(
        MISSING,
        "calibration.json of benchmarks.calibrate. The whole study is about the first; further "
        "ones, such as one for each family, are tested in buildings like their own",
        "FILE",
    )
    predictor: str = option("compact", "predictor that the calibrations were made for", "P")
    maps: tuple[str, ...] = option(
        (),
        "map_server .yaml files, or folders of them: real buildings to drive in as well",
        "W",
    )
    runs: tuple[Path, ...] = option(
        (),
        "folders of benchmarks.corridor, driven at a risk of 0: their drives are tested for "
        "contacts and counted as well",
        "DIR",
    )
    hours: float = option(
        4.0, "longest run time [h]; all series of drives grow in turn", "H", low=0, high=1e4
    )
    quick: bool = option(False, "make only 4 drives of each series, as a trial")
    jobs: int = jobs_option()
    out: Path = option(
        Path("results/risk"), "folder of results.json, the figures and the drives", "DIR"
    )


def _run(settings: RiskSettings) -> int:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.calibration.certificate import absent_in, load_calibration
    from benchmarks.studies.risk.series import list_series
    from foresee.infra.resumable import ResumableFolder
    from sim.buildings import check_maps

    calibration, *others = (load_calibration(path) for path in settings.calibration)
    check_maps(settings.maps)
    all_series = list_series(
        calibration,
        others,
        settings.predictor,
        settings.maps,
        settings.quick,
    )
    conditions = calibration.conditions | {"quick": settings.quick}
    with ResumableFolder(settings.out, conditions, absent=absent_in(conditions), exclusive=True):
        return _study(settings, calibration, all_series)


def _study(settings: RiskSettings, calibration: Calibration, all_series: list[Series]) -> int:
    from benchmarks.runs.drive_series import drive_all
    from benchmarks.studies.risk.drives import KIND, driven, saved_drives
    from benchmarks.studies.risk.figures import draw
    from benchmarks.studies.risk.report import (
        collision_rows,
        exceeds_its_risk,
        pooled_rows,
        speed_rows,
    )
    from benchmarks.studies.risk.tables import tables
    from foresee.infra.environment import commit, machine
    from foresee.infra.results_file import write_results

    saved_series, saved = saved_drives(settings.runs)
    drives, missing = drive_all(
        all_series, settings.out / "drives", KIND, driven, settings.hours, settings.jobs
    )
    rows = collision_rows([*all_series, *saved_series], drives | saved, calibration.levels)
    results = {
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
    }
    write_results(settings.out / "results.json", "risk", results)
    print("", tables(results), "", sep="\n")
    for path in [*draw(results, settings.out), settings.out / "results.json"]:
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


main = Command("benchmarks.studies.risk", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
