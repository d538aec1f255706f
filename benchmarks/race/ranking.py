"""The ranking of a race: a table of the entries, and the duel of each two."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Self

import numpy as np
from scipy.stats import binomtest

from benchmarks.runs import statistics
from benchmarks.runs.arms import ARMS
from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.statistics import ResultsByArm
from foresee.infra.command_line import UsageError
from foresee.infra.environment import several_states
from foresee.infra.errors import shown
from foresee.infra.markdown import DASH, interval, markdown, span
from foresee.infra.plain_json import fits
from sim.suite import Suite

FACTS = {
    **dict.fromkeys(("suite", "digest", "name"), str),
    "buildings": int,
    "entry": dict[str, str | None],
    "risk": float,
    "uncertified": bool,
    "calibration": str | None,
    "machine": dict[str, str | int | dict[str, str] | None],
}
"""Settings that each file of a race must have, and their types."""
LONGEST_NAME = 40
"""Length above which a name is cut [characters]."""
SHORT = 10
"""Number of digits of a hash that a table shows."""


@dataclass(frozen=True)
class Entrant:
    """The drives of one file of a race.

    Attributes:
        path: the file.
        settings: settings of the file.
        drives: results of the drives, in the order of the buildings.
        maps: hash of the true map in which each was made.
    """

    path: Path
    settings: dict[str, Any]
    drives: list[DriveResult]
    maps: list[str]

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file of `foresee bench`.

        Raises:
            UsageError: if it is none, or has not all of its drives.
        """
        content = read_drives(path, "race", {"index": int, "map": str})
        older = {"risk": 0.0, "uncertified": False, "calibration": None}
        settings = older | content["settings"]
        wrong = [name for name, hint in FACTS.items() if not fits(settings.get(name), hint)]
        if wrong:
            raise UsageError(f"{path} is no file of foresee bench: it has no proper {wrong[0]}")
        drives = sorted(content["drives"], key=lambda drive: drive["index"])
        count = settings["buildings"]
        if len(drives) != count or any(i != drive["index"] for i, drive in enumerate(drives)):
            raise UsageError(
                f"{path} has {len(drives)} of {count} drives: give its command foresee bench again"
            )
        try:
            results = [DriveResult.from_json(drive) for drive in drives]
        except ValueError as error:
            raise UsageError(f"{path} is no file of foresee bench: {error}") from None
        return cls(path, settings, results, [drive["map"] for drive in drives])

    @property
    def name(self) -> str:
        """Name of the entry."""
        return shown(self.settings["name"], LONGEST_NAME)


def read_entrants(paths: Sequence[Path]) -> list[Entrant]:
    """Read the files of a race, and check that they are of the same one.

    Raises:
        UsageError: if a file is none of `foresee bench` or is unfinished, if they are of several
            suites, if a drive was in another building than the suite of this version has, or if
            two entries have the same name.
    """
    entrants = [Entrant.read(path) for path in paths]
    first = entrants[0]
    suite = Suite.read(first.settings["suite"])
    for entrant in entrants:
        if entrant.settings["suite"] != suite.name:
            raise UsageError(
                f"{entrant.path} is of suite {entrant.settings['suite']}, {first.path} of "
                f"{suite.name}: only drives in the same buildings can be ranked"
            )
        driven = zip(entrant.maps, entrant.drives, strict=True)
        present = [(digest, drive.seed) for digest, drive in driven]
        wanted = [(place.map, place.seed) for place in suite.places]
        if not 0 < len(present) <= len(wanted):
            raise UsageError(f"{entrant.path} has {len(present)} of {len(wanted)} buildings")
        others = [i for i, pair in enumerate(present) if pair != wanted[i]]
        if entrant.settings["digest"] != suite.digest or others:
            where = f"building {others[0]} is another" if others else "its digest is another"
            raise UsageError(
                f"{entrant.path} was not driven in the suite {suite.name} of this version of "
                f"foresee: {where}"
            )
        if sum(entrant.name == other.name for other in entrants) > 1:
            raise UsageError(
                f"{entrant.path}: two entries are called {entrant.name!r}: give foresee bench a "
                "--name"
            )
    return entrants


def ranking_page(entrants: Sequence[Entrant]) -> str:
    """Return the ranking of a race as a page in Markdown.

    The drives are those of the smallest file: small and full sizes begin with the same buildings.

    Args:
        entrants: the entries, at least one.
    """
    suite = Suite.read(entrants[0].settings["suite"])
    count = min(len(entrant.drives) for entrant in entrants)
    arms = {e.name: [replace(drive, arm=e.name) for drive in e.drives[:count]] for e in entrants}
    scores = {name: statistics.success(arms, name) for name in arms}
    order = sorted(entrants, key=lambda e: -(scores[e.name] or {"value": 0.0})["value"])
    names = [entrant.name for entrant in order]
    rules = (
        f"{count} of {len(suite.places)} buildings, "
        f"{'prescribed' if suite.route == 'fixed' else 'free'} route, window {suite.window:g} m, "
        f"top speed {suite.v_max:g} m/s, "
        f"{'with' if suite.reverse else 'without'} a reverse gear; suite {suite.digest[:SHORT]}."
    )
    parts = [
        f"# Ranking: {suite.name}",
        rules,
        "Ordered by SCT, success weighted by completion time: the mean of (least time for the "
        "shortest path) / (time), 0 for a drive that did not reach the goal. Brackets give 95 % "
        "confidence intervals over buildings, from 20 buildings on.",
        markdown([HEADER, *(_row(place, e, arms) for place, e in enumerate(order, 1))]),
    ]
    if len(names) > 1:
        parts += [
            "## Duels",
            "*Faster* is the number of buildings in which the first was faster than the second, "
            "and the other way round; to reach the goal is faster than not to. p is that of the "
            "two-sided sign test, without a correction for the number of duels. The time ratio is "
            "the time of the first divided by that of the second, where both reached the goal.",
            markdown([DUELS, *(_duel(arms, *pair) for pair in combinations(names, 2))]),
        ]
    parts += [
        "## Entries",
        "To repeat one, check out its commit, and give the command with an --out.",
        markdown([ENTRIES, *(_repeat(suite, entrant) for entrant in order)]),
    ]
    mixed = several_states((d.commit for e in order for d in e.drives), "drives")
    if mixed:
        parts.append("The entries were driven with several versions of the code.")
    return "\n\n".join(parts) + "\n"


HEADER = [
    *("", "entry", "SCT", "speed [m/s]", "reached", "collided", "timed out", "stuck"),
    *("hard stops", "promises broken", "cycle p50 / p99 [ms]"),
]
DUELS = ["first", "second", "faster", "p", "time ratio"]
ENTRIES = ["entry", "command", "commit", "weights or source", "processor"]


def _row(place: int, entrant: Entrant, arms: ResultsByArm) -> list[str]:
    name = entrant.name
    drives = arms[name]

    def count(outcome: str) -> str:
        return str(sum(drive.outcome == outcome for drive in drives))

    collided = [drive.outcome == "collided" for drive in drives]
    ends = statistics.rate_interval(collided, [drive.world for drive in drives])
    cycle = np.median([drive.cycle_ms for drive in drives], axis=0)
    return [
        str(place),
        name + _remark(entrant, sum(drive.learned for drive in drives)),
        interval(statistics.success(arms, name), ".2f"),
        interval(statistics.mean_speed(arms, name), ".2f"),
        count("reached"),
        f"{count('collided')} ({span(ends, '.0f', 100, ' %')})",
        count("timed_out"),
        count("stuck"),
        str(sum(drive.hard_stops or 0 for drive in drives)),
        interval(statistics.promises_broken(drives), ".1f", 100, " %") or DASH,
        " / ".join(f"{value:.0f}" for value in cycle),
    ]


def _remark(entrant: Entrant, learned: int) -> str:
    """Return what must be said of an entry beside its name.

    Args:
        entrant: the entry.
        learned: number of buildings in which its network was trained.
    """
    entry = entrant.settings["entry"]
    arm = ARMS.get(str(entry.get("of"))) if entry.get("kind") == "arm" else None
    said = []
    if arm is not None and (arm.whole_map or arm.predictor == "oracle"):
        said.append("knows the true map")
    if any(drive.uncertified for drive in entrant.drives):
        said.append("not certified")
    if any(drive.earlier_calibration for drive in entrant.drives):
        said.append("calibrated with an earlier planner")
    if learned:
        said.append(f"trained in {learned} of these buildings")
    return f" ({', '.join(said)})" if said else ""


def _duel(arms: ResultsByArm, first: str, second: str) -> list[str]:
    """Return the row of two entries: on the same buildings, each pair of drives counts once."""
    wins = [0, 0]
    for a, b in zip(arms[first], arms[second], strict=True):
        times = [d.time if d.outcome == "reached" else float("inf") for d in (a, b)]
        if times[0] != times[1]:
            wins[times[1] < times[0]] += 1
    p = float(binomtest(wins[0], sum(wins)).pvalue) if any(wins) else 1.0
    ratio = statistics.time_ratio(arms, first, second)
    return [first, second, f"{wins[0]} : {wins[1]}", f"{p:.2g}", interval(ratio, ".2f") or DASH]


def _repeat(suite: Suite, entrant: Entrant) -> list[str]:
    settings, entry = entrant.settings, entrant.settings["entry"]
    size = "small" if settings["buildings"] == suite.count("small") else "full"
    commits = {drive.commit for drive in entrant.drives}
    words = ["foresee", "bench", "--suite", settings["suite"], "--size", size]
    words += [f"--{entry.get('kind')}", str(entry.get("of"))]
    if settings["risk"]:
        words += ["--risk", f"{settings['risk']:g}"]
    if settings["calibration"]:
        words += ["--calibration", settings["calibration"]]
    if settings["uncertified"]:
        words.append("--uncertified")
    return [
        entrant.name,
        f"`{shlex.join(words)}`",
        ", ".join(sorted(str(c)[:SHORT] for c in commits)),
        str(entry.get("fingerprint") or DASH)[:SHORT],
        str(settings["machine"].get("processor", DASH)),
    ]
