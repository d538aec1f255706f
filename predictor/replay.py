"""Replay a robot's log or bag: map its scans, predict, and write an MCAP file for Foxglove.

    foresee replay drive.bag --out drive.mcap

The scans are mapped, and the unobserved cells predicted, as the car would have done along the
robot's drive. FILE.mcap then holds the observed and the predicted map, the confidence, the poses,
the driven path and the scans; FILE.layout.json is a layout for Foxglove that shows them. Both are
written whole or not at all, and no file is overwritten.
"""

from __future__ import annotations

import sys
import time
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Annotated

from foresee.infra.command_line import Command, Section, UsageError
from foresee.infra.options import Options, argument, option
from predictor.data import LOG_FORMATS
from predictor.data.bag_config import BagConfig
from predictor.evaluation.settings import ReplayConfig

SUFFIX = ".mcap"
"""Ending of the file that is written."""


@dataclass(frozen=True)
class Place(Options):
    """What is replayed, and where it is written."""

    log: Path = argument(f"log with corrected poses: {LOG_FORMATS}", "LOG")
    out: Path = option(MISSING, "file to write; a layout is written beside it", "FILE.mcap")


def _run(
    place: Place, config: ReplayConfig, topics: Annotated[BagConfig, Section("of a bag")]
) -> None:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from foresee.infra.atomic_file import write_whole
    from predictor.data.foxglove_layout import ENDING, foxglove_layout
    from predictor.data.laser_log import LogError
    from predictor.data.log_files import read_log
    from predictor.evaluation.replayed_log import PACE, replay

    out = place.out
    if out.suffix != SUFFIX:
        raise UsageError(f"--out is {out}, its name must end in {SUFFIX}")
    layout = out.with_suffix(ENDING)
    for path in (out, layout):
        if path.exists():
            raise UsageError(f"--out: {path} exists: remove it, or choose another name")
    if not place.log.exists():
        raise LogError(f"{place.log}: no such file")
    log = read_log(place.log, topics)
    skipped = "".join(f"; skipped: {count} {what}" for what, count in log.skipped.items() if count)
    print(f"{log.name}: {len(log)} scans{skipped}", *log.notes, sep="\n", file=sys.stderr)
    if log.times is None:
        print(
            f"its clock cannot be used: the robot is taken to have driven at {PACE:g} m/s",
            file=sys.stderr,
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    result = replay(log, config, out)
    taken = time.perf_counter() - began
    write_whole(layout, foxglove_layout().encode())
    if result.nan_cells:
        print(f"{config.predictor}: {result.nan_cells} predicted cells are NaN", file=sys.stderr)
    print(
        f"{result.scans} scans and {result.maps} predictions of {result.duration:.0f} s in "
        f"{taken:.0f} s",
        out,
        layout,
        sep="\n",
    )


main = Command("predictor.replay", __doc__, _run, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
