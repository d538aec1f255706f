"""Drive with hostile predictors in hard buildings, with odd cars; no car may collide.

    python -m benchmarks.studies.robustness.attack --drives 100

The predictors predict falsely, write into their arguments, answer late, raise and break the
contract, at reliances from 0 to 0.99. The buildings are of all families, with cells of 0.01 to
0.5 m and walls of one cell; cars have any body and turning radius that is admitted, and may have to
back out at the start. With --errors, the robot's pose, ranges and controls are wrong
by as much as the navigator is told that they may be, in the worst ways; a seventh of these drives
has an honest predictor, and should reach a goal 10 m away. Collisions, contacts of the exact body,
false observations and crashes of the program are counted: there may be none. Interrupted, it
continues when the same command is given again. Exit status: 1 if there was any.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.runs.drive_file import DriveFile
from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, jobs_option, option
from planner.revision import REVISION

SEED = 990_000
"""Seed of the first building; no network was trained in a building of such seeds."""


@dataclass(frozen=True)
class AttackSettings(Options):
    """Settings that decide the drives of an attack."""

    drives: int = option(1000, "number of drives", "N", low=1, high=10**9)
    seed: int = option(SEED, "seed of the first building", "N", low=0, high=2**31)
    seconds: float = option(
        4.0, "longest duration of a drive, in simulated time [s]", "S", low=0.1, high=1e6
    )
    errors: bool = option(False, "the robot has errors, the worst within their bounds")
    maps: tuple[str, ...] = option(
        (),
        "map_server .yaml files, or folders of them: real buildings to drive in as well, with "
        "--errors",
        "W",
    )


@dataclass(frozen=True)
class Place(Options):
    """Options of where the drives are computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(Path("results/attack.json"), "file of the drives", "FILE")


def _run(settings: AttackSettings, place: Place) -> int:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.runs.drive import run_fingerprint
    from benchmarks.runs.settings import Settings
    from benchmarks.studies.robustness.hostile_drives import attacked, failures, table
    from benchmarks.studies.robustness.scenario import SITUATIONS
    from sim.buildings import check_maps, map_hashes, sources

    if settings.maps and not settings.errors:
        raise UsageError("--maps needs --errors")
    check_maps(settings.maps)

    # Drives of other kinds, or of an earlier planner, are not continued.
    identity = asdict(settings) | {"situations": list(SITUATIONS), "revision": REVISION}
    if settings.maps:
        identity["map_hashes"] = map_hashes(settings.maps)
    if settings.errors:
        # Of the honest predictor.
        identity["weights"] = run_fingerprint(Settings())
    # Older files do not name the contents of their maps, which are not compared then.
    absent: dict[str, Any] = {"errors": False, "maps": [], "map_hashes": identity.get("map_hashes")}
    store = DriveFile(place.out, "attack", identity, grows="drives", absent=absent)
    maps = tuple(sources(settings.maps))
    work = partial(attacked, settings.seed, settings.seconds, errors=settings.errors, maps=maps)
    store.fill(work, range(settings.drives), place.jobs, lambda drive: str(drive["situation"]))
    drives = store.first(settings.drives)
    print(table({"drives": drives}), "", place.out, sep="\n")
    failed = list(failures(drives))
    print(*failed, sep="\n", end="\n" if failed else "")
    return 1 if failed else 0


main = Command("benchmarks.studies.robustness.attack", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
