"""Make training samples for the network compact on simulated walks through buildings.

    foresee drives                        the truth is the whole building
    foresee drives --simulated-logs 1     the truth is the map of a simulated log

A point walks along the planner's routes, without prediction and without a car's dynamics. Each
walk is replayed with LIDARs of other windows and other noise. Interrupted, it continues when the
same command is given again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Annotated

from foresee.infra.command_line import Command, Section
from foresee.infra.options import Options, jobs_option
from predictor.data.bag_config import BagConfig
from predictor.recording.settings import DrivesConfig


@dataclass(frozen=True)
class Place(Options):
    """Options of where the drives are made; none of them changes a result."""

    jobs: int = jobs_option()


def _run(
    config: DrivesConfig, topics: Annotated[BagConfig, Section("bags of --world")], place: Place
) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from predictor.recording.training_drives import make

    make(replace(config, topics=topics), place.jobs)


main = Command("predictor.drives", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
