"""Measure what errors of a robot and late predictions cost, and where cars collide nevertheless.

    python -m benchmarks.studies.robustness.errors --part cost --out results/errors-cost.json

beyond: one error at a time is up to 5 times what the navigator is told, in the worst ways. cost:
time ratios of errors that keep to their bounds. late: time ratios where predictions come up to 1 s
late. people: contacts with people, who do not keep to the assumption of a static world.
Interrupted, it continues when the same command is given again.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.runs.drive_file import DriveFile
from foresee.infra.command_line import Command
from foresee.infra.options import Options, jobs_option, option
from planner.revision import REVISION

PARTS = ("beyond", "cost", "late", "people")
"""Parts of the study."""
SEED = 991_000_000
"""Seed of the first building; no network was trained in a building of such seeds."""


@dataclass(frozen=True)
class ErrorSettings(Options):
    """Settings that decide the drives."""

    part: str = option("beyond", "part of the study", choices=PARTS)
    buildings: int = option(24, "number of buildings", "N", low=1, high=10**6)
    seed: int = option(SEED, "seed of the first building", "N", low=0, high=2**31)


@dataclass(frozen=True)
class Place(Options):
    """Options of where the drives are computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(Path("results/errors.json"), "file of the drives", "FILE")


def _run(settings: ErrorSettings, place: Place) -> int:
    # Imported here, so that --help does not wait for slow imports.
    from functools import partial

    from benchmarks.runs.drive import run_fingerprint
    from benchmarks.runs.settings import Settings
    from benchmarks.studies.robustness.error_drives import cases_of, driven_case
    from benchmarks.studies.robustness.error_tables import table

    cases = list(cases_of(settings.part))
    identity = asdict(settings) | {"revision": REVISION, "weights": run_fingerprint(Settings())}
    store = DriveFile(place.out, "errors", identity | {"cases": cases}, grows="buildings")
    count = settings.buildings * len(cases)
    work = partial(driven_case, settings.part, settings.seed)
    store.fill(work, range(count), place.jobs, lambda drive: str(drive["outcome"]))
    print(table(settings.part, store.first(count)), "", place.out, sep="\n")
    return 0


main = Command("benchmarks.studies.robustness.errors", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
