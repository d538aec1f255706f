"""Drive a suite of the race with an arm of this project, or a predictor or driver of your own.

    foresee bench --suite corridor-v1 --predictor my_module:MyPredictor --out mine.json

All entries of a suite drive in the same buildings, with the same scans. The file of the results
holds what is needed to repeat them; `foresee rank` compares several. Interrupted, the command
continues when it is given again.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import MISSING, dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks.calibration.settings import refuse_without_risk
from foresee.infra.command_line import Command, UsageError
from foresee.infra.options import Options, given, jobs_option, option


@dataclass(frozen=True)
class RaceSettings(Options):
    """What drives, and where."""

    suite: str = option(
        MISSING, "corridor-v1, office-v1, floor-plans-v1 or mixed-v1: the buildings", "SUITE"
    )
    out: Path = option(MISSING, "file of the results", "FILE.json")
    size: str = option(
        "full",
        "small: the first 12 buildings of the suite; full: all 60",
        choices=("small", "full"),
    )
    predictor: str | None = option(
        None, "predictor with which the arm predicted drives, as in foresee corridor", "P"
    )
    driver: str | None = option(
        None,
        "driver of your own, module:Class: a class with the method control(state, scan, known)",
        "D",
    )
    arm: str | None = option(None, "arm of this project, such as known", "ARM")
    risk: float = option(
        0.0,
        "accepted probability of a collision in a drive of --predictor; 0: collisions are "
        "excluded by construction",
        "RISK",
        low=0,
        high=1,
    )
    calibration: Path | None = option(
        None,
        "calibration.json of foresee calibrate for --risk (default: the one that ships with "
        "foresee for these drives)",
        "FILE",
    )
    uncertified: bool = option(
        False,
        "drive at a --risk without a calibration for these drives, as in foresee corridor: more "
        "drives than accepted may collide, and the ranking says so",
    )
    name: str | None = option(
        None, "name in the ranking (default: that of the predictor, driver or arm)", "NAME"
    )
    jobs: int = jobs_option()

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.entry) != 1:
            raise UsageError("give one of --predictor, --driver and --arm")
        if self.risk > 0 and self.predictor is None:
            raise UsageError("--risk needs --predictor: no other entry is told a risk")
        refuse_without_risk((self.risk,), self.calibration, self.uncertified)

    @property
    def entry(self) -> dict[str, str]:
        """The kind of what drives, and its name on the command line."""
        return given(predictor=self.predictor, driver=self.driver, arm=self.arm)


def _run(settings: RaceSettings) -> None:
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.calibration.certificate import at_risk
    from benchmarks.race.entry import Entry
    from benchmarks.race.race_drive import race_drive, settings_of
    from benchmarks.runs.drive_file import DriveFile
    from benchmarks.runs.warm_up import warm_up_if_cold
    from foresee.infra.environment import machine, own_version
    from planner.revision import FIRST, revision_of
    from sim.suite import Suite

    suite = Suite.read(settings.suite)
    ((kind, of),) = settings.entry.items()
    entry = Entry.load(kind, of)
    entry = replace(entry, risk=settings.risk, uncertified=settings.uncertified)
    families = tuple(dict.fromkeys(place.family for place in suite.places))
    seeds = [place.seed for place in suite.places]
    # A calibration must have driven in none of the buildings, so all seeds are asked for.
    everywhere = replace(
        settings_of(suite, entry, 0),
        world=families,
        seed=min(seeds),
        episodes=(max(seeds) - min(seeds) + 1) * len(families),
    )
    certified = at_risk(everywhere, settings.calibration)
    entry = replace(
        entry,
        level=certified.level,
        uncertified=certified.uncertified,
        calibrated=certified.calibrated,
    )
    risk = f" {100 * settings.risk:g} %" if settings.risk else ""
    count = suite.count(settings.size)
    facts = {
        "suite": suite.name,
        "digest": suite.digest,
        "buildings": count,
        "name": settings.name or of + risk,
        "entry": entry.facts,
        "sources": list(entry.sources),
        "risk": entry.risk,
        "level": entry.level,
        "uncertified": entry.uncertified,
        "calibration": settings.calibration and str(settings.calibration),
        "revision": revision_of(suite.route),
        "version": own_version(),
        "machine": machine(),
    }
    # Of a plug-in, older files cover the file of its class alone.
    older = {"sources": list(entry.sources[:1]), "risk": 0.0, "level": 0.0, "uncertified": False}
    older |= {"calibration": None, "revision": FIRST}
    warm_up_if_cold()
    file = DriveFile(settings.out, "race", facts, "buildings", older)
    file.fill(
        partial(race_drive, suite.name, entry),
        range(count),
        settings.jobs,
        lambda drive: f"{drive['outcome']} in {drive['time']:.1f} s",
    )
    outcomes = Counter(drive["outcome"] for drive in file.first(count))
    print(f"{settings.out}: " + ", ".join(f"{n} {what}" for what, n in outcomes.most_common()))


main = Command("benchmarks.bench", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
