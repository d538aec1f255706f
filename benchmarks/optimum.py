"""Compute time-optimal drives of the car with the whole map known.

    foresee optimum --world office --episodes 24

The tasks are those of benchmarks.corridor. The project's planner is not used, so that it can be
compared with these drives. T_bound is a lower bound of the shortest possible time. T_opt is an
upper bound, since the simulated car drives it. Interrupted, it continues when the same command is
given again.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import Command, Section
from foresee.infra.options import Options, jobs_option, option

TASKS = Section(names=("world", "episodes", "seed", "v_max", "braking"))
"""Settings of a comparison that are also options of this command."""


@dataclass(frozen=True)
class Place(Options):
    """Options of where the drives are computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(Path("results/optimum.json"), "file of the drives", "FILE")


def _run(settings: Annotated[Settings, TASKS], place: Place) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.runs.time_optimal import ENTRY, KIND, attempt, table
    from foresee.mapping.car_limits import CarLimits
    from sim.buildings import map_hashes
    from sim.episode import EpisodeConfig

    maps = map_hashes(settings.world)
    car = asdict(CarLimits(v_max=settings.v_max, braking=settings.braking))
    wanted = {"world": list(settings.world), "episodes": settings.episodes, "seed": settings.seed}
    wanted |= car | {"goal_radius": EpisodeConfig().goal_radius}
    wanted |= {"maps": maps} if maps else {}
    # Older files do not name their maps.
    store = DriveFile(place.out, KIND, wanted, "episodes", {"maps": maps} if maps else {}, ENTRY)
    skipped = store.fill(partial(attempt, settings), range(settings.episodes), place.jobs, _about)
    notes = [f"episode {index} left out: {why}" for index, why in skipped.items()]
    drives = store.first(settings.episodes)
    notes += [
        f"episode {d['index']}, {d['world']}: no drive found" for d in drives if d["t_opt"] is None
    ]
    print(*notes, "", table({"drives": drives}), "", place.out, sep="\n")


def _about(drive: dict[str, Any]) -> str:
    """Return building and T_opt of a drive for the progress bar."""
    took = "no drive found" if drive["t_opt"] is None else f"{drive['t_opt']:.2f} s"
    return f"{drive['world']} {took}"


main = Command("benchmarks.optimum", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
