"""Drive with hostile predictors in hard buildings, with odd cars; no car may collide.

    python -m benchmarks.studies.robustness.attack --drives 100

The predictors predict falsely, write into their arguments, answer late, raise and break the
contract, at reliances from 0 to 0.99. The buildings are of all families, with cells of 0.01 to
0.5 m and walls of one cell; cars have any body and turning radius that is admitted, and may have to
back out at the start. Collisions, contacts of the exact body, false observations and crashes of the
program are counted: there may be none. Interrupted, it continues when the same command is given
again. Exit status: 1 if there was any.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from benchmarks.runs.drive_file import DriveFile
from foresee.infra.command_line import Command
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


@dataclass(frozen=True)
class Place(Options):
    """Options of where the drives are computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(Path("results/attack.json"), "file of the drives", "FILE")


def _run(settings: AttackSettings, place: Place) -> int:
    # Imported here, so that --help does not wait for slow imports.
    from benchmarks.studies.robustness.hostile_drives import attacked, failures, table
    from benchmarks.studies.robustness.scenario import SITUATIONS

    # Drives of other kinds, or of an earlier planner, are not continued.
    identity = asdict(settings) | {"situations": list(SITUATIONS), "revision": REVISION}
    store = DriveFile(place.out, "attack", identity, grows="drives")
    work = partial(attacked, settings.seed, settings.seconds)
    store.fill(work, range(settings.drives), place.jobs, lambda drive: str(drive["situation"]))
    drives = store.first(settings.drives)
    print(table({"drives": drives}), "", place.out, sep="\n")
    failed = list(failures(drives))
    print(*failed, sep="\n", end="\n" if failed else "")
    return 1 if failed else 0


main = Command("benchmarks.studies.robustness.attack", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
