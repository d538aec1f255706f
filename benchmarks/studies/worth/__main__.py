"""Measure what prediction is worth against baselines without a network, at the same risk.

    python -m benchmarks.studies.worth --maps real_maps --hours 8

Drivers with and without a network drive the same tasks: on prescribed routes, with several windows
and top speeds, and on free routes. Each driver with a risk drives at the level that a calibration
certifies for it; where none is for these buildings, at that of the mixture, and the table says so.
Interrupted, it continues when the same command is given again. Exit status: 1 if a car collided at
a risk of 0.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foresee.infra.command_line import Command
from foresee.infra.options import Options, jobs_option, option
from foresee.mapping.family_names import FAMILIES

PARTS = ("prescribed", "windows", "free")
"""Parts of the study, see `benchmarks.studies.worth.series`."""


@dataclass(frozen=True)
class WorthSettings(Options):
    """What is driven, for how long, and where the results are written."""

    parts: tuple[str, ...] = option(PARTS, "parts of the study to drive", "P", choices=PARTS)
    tasks: tuple[str, ...] = option(
        ("mixture", *FAMILIES),
        "buildings of the prescribed routes: the mixture of five families, and families alone",
        "W",
        choices=("mixture", *FAMILIES),
    )
    maps: tuple[str, ...] = option(
        (), "map_server .yaml files, or folders of them: real buildings to drive in as well", "W"
    )
    predictors: tuple[str, ...] = option(
        ("distance", "extend", "compact"),
        "predictors to compare, such as also weights FILE.safetensors of the paper's networks; "
        "distance and extend are the baselines without a network at a risk above 0",
        "P",
    )
    calibrations: tuple[Path, ...] = option(
        (),
        "files of benchmarks.calibrate, besides the shipped ones, that give each predictor its "
        "levels; a predictor without any drives at a risk of 0 alone",
        "FILE",
    )
    buildings: int = option(
        40, "buildings of each kind; on free routes half as many again", "N", low=1, high=100_000
    )
    windows: tuple[float, ...] = option(
        (5.0, 10.0, 20.0), "windows of the part of that name [m]", "M", low=1, high=100
    )
    speeds: tuple[float, ...] = option(
        (4.0, 8.0), "top speeds of that part [m/s], each with each window", "V", low=0.5, high=10
    )
    hours: float = option(
        4.0, "longest run time [h]; all series of drives grow in turn", "H", low=0, high=1e4
    )
    jobs: int = jobs_option()
    out: Path = option(
        Path("results/worth"), "folder of results.json, the figure and the drives", "DIR"
    )


def _run(settings: WorthSettings) -> int:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.runs.drive_series import drive_all
    from benchmarks.studies.worth.drives import KIND, driven
    from benchmarks.studies.worth.figures import draw
    from benchmarks.studies.worth.report import rows
    from benchmarks.studies.worth.series import list_series
    from benchmarks.studies.worth.tables import tables
    from foresee.infra.environment import commit, machine
    from foresee.infra.results_file import write_results
    from foresee.infra.resumable import ResumableFolder
    from sim.buildings import check_maps

    check_maps(settings.maps)
    all_series, left_out = list_series(
        settings.parts,
        settings.tasks,
        settings.maps,
        settings.predictors,
        settings.calibrations,
        settings.buildings,
        list(dict.fromkeys((w, v_max) for v_max in settings.speeds for w in settings.windows)),
    )
    with ResumableFolder(settings.out, exclusive=True):
        drives, missing = drive_all(
            all_series, settings.out / "drives", KIND, driven, settings.hours, settings.jobs
        )
        results: dict[str, Any] = {
            "machine": machine(),
            "commit": commit(),
            "seed": all_series[0].settings.seed,
            "rows": rows(all_series, drives),
            "left_out": left_out,
            "missing": missing,
        }
        write_results(settings.out / "results.json", "worth", results)
    print("", tables(results), "", sep="\n")
    for path in [*draw(results, settings.out), settings.out / "results.json"]:
        print(path)
    # Of all drives: the rows are of those alone that all drivers of a group have made.
    of_no_risk = (drives[series.name] for series in all_series if not series.settings.risk)
    return int(any(drive["outcome"] == "collided" for of in of_no_risk for drive in of))


main = Command("benchmarks.studies.worth", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
