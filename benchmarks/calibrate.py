"""Calibrate the last resort: find the largest level that is certified for each risk.

    foresee calibrate --world corridor narrow office paper --risks 0.05 0.02

A level decides how far the last resort may rely on predictions; it is certified if the
probability of a collision in a drive stays below the risk. The method is learn-then-test on drives
at each level, from the safest level to the boldest. Interrupted, it continues when the same command
is given again. Exit status: 1 if a risk has no certified level.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from benchmarks.calibration.settings import OF_DRIVES, CalibrateSettings
from benchmarks.runs.settings import HEADINGS, Settings
from foresee.infra.command_line import Command, Section
from foresee.infra.options import Options, jobs_option, option


@dataclass(frozen=True)
class Place(Options):
    """Options of where a calibration is computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(
        Path("results/calibration"), "folder of calibration.json and of the drives", "DIR"
    )


def _run(
    calibration: CalibrateSettings,
    settings: Annotated[Settings, Section(names=OF_DRIVES, below=HEADINGS)],
    place: Place,
) -> int:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.calibration.learn_then_test import calibrate, table
    from sim.buildings import check_maps

    check_maps(settings.world)
    results = calibrate(settings, calibration, place.out, place.jobs)
    print(table(results), "", place.out / "calibration.json", sep="\n")
    return 0 if len(results["certified"]) == len(calibration.risks) else 1


main = Command("benchmarks.calibrate", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
