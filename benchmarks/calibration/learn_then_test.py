"""Calibration by learn-then-test: the largest level λ of the last resort certified for a risk δ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration.certificate import absent_in, conditions_for
from benchmarks.calibration.settings import CalibrateSettings
from benchmarks.runs.arms import CALIBRATED_ARM
from benchmarks.runs.drive import attempt, run_fingerprint
from benchmarks.runs.drive_file import NO_TASK, DriveFile
from benchmarks.runs.settings import OLDER, Settings
from benchmarks.runs.statistics import rate_interval
from foresee.infra.command_line import UsageError
from foresee.infra.environment import machine
from foresee.infra.markdown import DASH, records, span
from foresee.infra.results_file import write_results
from foresee.infra.resumable import ResumableFolder
from planner.revision import FIRST, revision_of
from planner.risk.betting import capital, decided_after, needed
from planner.risk.calibration import KIND
from sim.buildings import sources

KIND_OF_DRIVES = "calibration drives"
"""Kind, in the sense of `results_file`, of the files that contain the drives at one level."""
ENTRY = {"index": int, "place": str, "outcome": str}
"""Facts of each entry in these files, and their types."""
KEPT = (
    "world",
    "seed",
    "learned",
    "outcome",
    "time",
    "path_length",
    "sct",
    "impact_speed",
    "ticks",
    "promises",
    "promises_broken",
    "commit",
)
"""Fields of `DriveResult` that these files keep of each drive."""


@dataclass(frozen=True)
class Tested:
    """The drives at one level, and the test of each risk on them.

    Attributes:
        level: level λ of the last resort.
        drives: drives in order, as many as the tests needed, n.
        capital: risk δ → the gambler's capital after each drive, (n,).
    """

    level: float
    drives: list[dict[str, Any]]
    capital: dict[float, NDArray[np.float64]]


def calibrate(settings: Settings, asked: CalibrateSettings, out: Path, jobs: int) -> dict[str, Any]:
    """Test one level after the other, from the safest on, and write calibration.json.

    Args:
        settings: settings of the drives.
        asked: risks, levels and confidence of the calibration.
        out: folder of calibration.json and of the drives; an interrupted calibration in it is
            continued.
        jobs: number of worker processes.

    Returns:
        The contents of calibration.json.

    Raises:
        UsageError: if there are too few drives to certify a risk, the predictor was trained in the
            buildings of the drives, or the folder holds another calibration.
    """
    wanted = needed(asked.confidence)
    for risk in asked.risks:
        best = capital(np.zeros(asked.drives), risk)
        if best[-1] < wanted:
            raise UsageError(
                f"--drives {asked.drives} cannot certify a risk of {risk:g}, even if none collides"
            )
    conditions = conditions_for(settings)
    # Levels and buildings must not be changed later: the certificate needs them chosen in advance.
    # Nor may the driving: the drives must be alike.
    identity = asdict(asked) | conditions | {"revision": revision_of(settings.route)}
    absent = absent_in(conditions) | {"revision": FIRST}
    with ResumableFolder(out, identity, grows=("drives",), absent=absent, exclusive=True):
        return _calibrate(settings, asked, out, jobs, conditions)


def _calibrate(
    settings: Settings, asked: CalibrateSettings, out: Path, jobs: int, conditions: dict[str, Any]
) -> dict[str, Any]:
    open_risks, certified = list(asked.risks), dict[float, float]()
    tests: list[Tested] = []
    for level in sorted(asked.levels):
        if not open_risks:
            break
        print(f"level {level:g}")
        tested = _test(settings, asked, level, open_risks, out, jobs)
        tests.append(tested)
        for risk in list(open_risks):
            if (tested.capital[risk] >= needed(asked.confidence)).any():
                certified[risk] = level
            else:
                open_risks.remove(risk)
    content = {
        "conditions": conditions,
        "confidence": asked.confidence,
        "seed": asked.seed,
        "revision": revision_of(settings.route),
        "risks": list(asked.risks),
        "sequence": sorted(asked.levels),
        "most_drives": asked.drives,
        "machine": machine(),
        "commits": sorted({str(d["commit"]) for tested in tests for d in tested.drives}),
        "certified": {f"{risk:g}": level for risk, level in sorted(certified.items())},
        "levels": [_summary(tested) for tested in tests],
    }
    write_results(out / "calibration.json", KIND, content)
    return content


def _test(
    settings: Settings,
    asked: CalibrateSettings,
    level: float,
    risks: Sequence[float],
    out: Path,
    jobs: int,
) -> Tested:
    """Drive at a level until the test of each risk is decided."""
    wanted = needed(asked.confidence)
    settings = replace(
        settings, seed=asked.seed, level=level, arms=(CALIBRATED_ARM,), episodes=asked.drives
    )
    weights = run_fingerprint(settings)
    identity = {k: v for k, v in asdict(settings).items() if k != "arms"} | {"weights": weights}
    absent = {name: value for name, value in OLDER.items() if name in identity}
    path = out / f"level-{level:g}.json"
    file = DriveFile(path, KIND_OF_DRIVES, identity, "episodes", absent, ENTRY)

    def decided() -> bool:
        losses = _losses(_in_order(file, asked.drives))
        return all(decided_after(losses, risk, asked.drives, wanted) is not None for risk in risks)

    work = partial(_driven, settings, weights)
    file.fill(work, range(asked.drives), jobs, lambda d: str(d["outcome"]), decided)
    drives = _in_order(file, asked.drives)
    # Only the drives that the slowest decision needed, whatever more the worker processes made.
    ends = [decided_after(_losses(drives), risk, asked.drives, wanted) for risk in risks]
    drives = drives[: max(len(drives) if end is None else end for end in ends)]
    if not drives:
        raise UsageError("--world: no drive is possible in these buildings")
    if any(drive["learned"] for drive in drives):
        raise UsageError("the predictor has learned from these buildings: choose another --seed")
    losses = _losses(drives)
    return Tested(level, drives, {risk: capital(losses, risk) for risk in risks})


def _losses(drives: list[dict[str, Any]]) -> list[bool]:
    return [drive["outcome"] == "collided" for drive in drives]


def _in_order(file: DriveFile, most: int) -> list[dict[str, Any]]:
    """Return the first drives without a gap, except for those in buildings without a task."""
    return [drive for drive in file.unbroken(most) if drive["outcome"] != NO_TASK]


def _driven(settings: Settings, weights: str | None, index: int) -> dict[str, Any]:
    """Drive once, and return the entry of the drive in the file of drives.

    The kind of building is drawn at random. If the kinds took turns, the drives would not be
    independent draws from the mixture, as the test requires.
    """
    places, seed = sources(settings.world), settings.seed + index
    place = places[int(np.random.default_rng([seed, 3]).integers(len(places)))]
    entry = {"index": index, "place": Path(place).stem}
    single = replace(settings, world=(place,), seed=seed, episodes=1)
    driven = attempt(single, weights, (0, CALIBRATED_ARM))
    if isinstance(driven, str):
        return entry | {"outcome": NO_TASK, "note": driven}
    return entry | {name: getattr(driven.result, name) for name in KEPT}


def _summary(tested: Tested) -> dict[str, Any]:
    """Return the entry of a level in calibration.json."""
    drives = tested.drives
    outcomes = Counter(d["outcome"] for d in drives)
    places = Counter(d["place"] for d in drives)
    bad = Counter(d["place"] for d in drives if d["outcome"] == "collided")
    metres, seconds = (sum(d[name] for d in drives) for name in ("path_length", "time"))
    return {
        "level": tested.level,
        "drives": len(drives),
        "collided": outcomes["collided"],
        "nominal_interval": rate_interval(_losses(drives), [str(d["world"]) for d in drives]),
        "km": metres / 1e3,
        "outcomes": dict(outcomes),
        "by_world": {place: [bad[place], places[place]] for place in sorted(places)},
        "capital": {f"{risk:g}": float(money.max()) for risk, money in tested.capital.items()},
        "speed": metres / seconds if seconds else None,
    }


def table_of_drives(content: dict[str, Any]) -> str:
    """Return a table of the drives at one level as Markdown.

    Args:
        content: contents of a file of drives of a calibration.
    """
    drives = [drive for drive in content["drives"] if drive["outcome"] != NO_TASK]
    tested = Tested(content["settings"]["level"], drives, {})
    return table({"levels": [_summary(tested)], "certified": {}})


def table(content: dict[str, Any]) -> str:
    """Return a calibration as a Markdown table, one line for each level.

    The intervals are nominal, since the number of drives depends on their outcomes.

    Args:
        content: contents of calibration.json.
    """
    certified = {float(risk): level for risk, level in content["certified"].items()}
    rows = []
    for entry in content["levels"]:
        risks = [f"{risk:g}" for risk, level in certified.items() if level >= entry["level"]]
        rows.append(
            {
                "level": f"{entry['level']:g}",
                "drives": entry["drives"],
                "collided": entry["collided"],
                "nominal 95 % interval": span(entry["nominal_interval"], ".1f", 100.0, " %"),
                "km": f"{entry['km']:.1f}",
                "speed [m/s]": f"{entry['speed']:.2f}" if entry["speed"] else DASH,
                "certified for risk": ", ".join(risks) or DASH,
            }
        )
    return records(rows)
