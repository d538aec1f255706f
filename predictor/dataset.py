"""Make the data sets of the prediction study: the paper's simulated one, and those of real logs.

    foresee dataset                                    simulated, with more test drives
    foresee dataset --log intel.log.gz aces.log.gz     from logs of real robots

A data set is like that of Katyal et al. 2018: for each tick of a drive, what the LIDAR has observed
around the car, and the true map there. Without --log the drives are simulated, six in two buildings
and more in others; with --log they are logs of real robots. docs/reference/files.md describes
the contents; `predictor.data.frames.Frames` reads them. Interrupted, it continues when the same
command is given again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from foresee.infra.command_line import Command, Section, UsageError
from foresee.infra.options import Options, jobs_option, option
from predictor.data import LOG_FORMATS, PHYSICAL, SIMULATED
from predictor.data.bag_config import BagConfig
from predictor.recording.settings import SimulatedConfig


@dataclass(frozen=True)
class Place(Options):
    """Options of where the data set is made."""

    out: Path | None = option(
        None, f"folder of the set (default: {SIMULATED}, with --log {PHYSICAL})", "DIR"
    )
    jobs: int = jobs_option()


@dataclass(frozen=True)
class PhysicalConfig(Options):
    """Logs that a data set is made of."""

    log: tuple[Path, ...] = option(
        (), f"logs with corrected poses, or folders of them: {LOG_FORMATS}", "PATH"
    )


def _run(
    place: Place,
    simulated: Annotated[SimulatedConfig, Section("simulated; by default as the paper's set")],
    physical: Annotated[PhysicalConfig, Section("physical")],
    topics: Annotated[BagConfig, Section("physical")],
) -> None:
    wrong = simulated.changed() if physical.log else topics.changed()
    if wrong:
        raise UsageError(f"{wrong[0]} {'cannot be given with' if physical.log else 'needs'} --log")
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from predictor.data.log_files import logs_in
    from predictor.recording.data_sets import make_physical, make_simulated

    folder = place.out or (PHYSICAL if physical.log else SIMULATED)
    if physical.log:
        make_physical(folder, logs_in(list(physical.log)), topics, place.jobs)
    else:
        make_simulated(folder, simulated, place.jobs)
    print(folder)


main = Command("predictor.dataset", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
