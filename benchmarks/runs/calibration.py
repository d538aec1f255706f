"""Learn-then-test: the largest level of the last resort whose collisions stay below a bound."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.betting import capital
from benchmarks.runs.calibration_settings import CalibrateSettings
from benchmarks.runs.certified import conditions_of
from benchmarks.runs.drive import attempt, sources
from benchmarks.runs.drive_file import DriveFile
from benchmarks.runs.settings import Settings
from benchmarks.runs.statistics import wilson
from planner.risk.calibration import KIND
from predictor.infra.command_line import UsageError
from predictor.infra.environment import machine
from predictor.infra.markdown import DASH, records
from predictor.infra.results_file import write_results
from predictor.infra.resumable import ResumableFolder
from predictor.provenance import fingerprint_of
from predictor.registry import load_predictor

ARM = "predicted"
KINDS = "calibration drives"
"""Kind of the files of drives."""
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
"""What the file of drives holds of a result."""


@dataclass(frozen=True)
class Tested:
    """The drives at a level, and what they say about each risk.

    Attributes:
        level: λ.
        drives: as far as they were needed, in their order.
        capital: risk δ → the gambler's capital after each of them, (n,).
    """

    level: float
    drives: list[dict[str, Any]]
    capital: dict[float, NDArray[np.float64]]


def calibrate(settings: Settings, asked: CalibrateSettings, out: Path, jobs: int) -> dict[str, Any]:
    """Test one level after the other, and write what they certify to `out`.

    Args:
        settings: of the drives.
        asked: what to certify.
        out: folder of calibration.json and of the drives, which it takes up again.
        jobs: worker processes.

    Returns:
        What calibration.json holds.

    Raises:
        UsageError: if the drives are too few for a risk, in buildings that the predictor has
            learned from, or the folder holds another calibration.
    """
    wanted = 1.0 / (1.0 - asked.confidence)
    for risk in asked.risks:
        best = capital(np.zeros(asked.drives), risk)
        if best[-1] < wanted:
            raise UsageError(
                f"--drives {asked.drives} cannot certify a risk of {risk:g}, even if none collides"
            )
    conditions = conditions_of(settings)
    # Other levels, or other buildings, would be another test, and might not be chosen afterwards.
    told = asdict(asked) | conditions
    with ResumableFolder(out, json.loads(json.dumps(told)), grows=("drives",), exclusive=True):
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
            if (tested.capital[risk] >= 1.0 / (1.0 - asked.confidence)).any():
                certified[risk] = level
            else:
                open_risks.remove(risk)
    found = {
        "conditions": conditions,
        "confidence": asked.confidence,
        "seed": asked.seed,
        "risks": list(asked.risks),
        "sequence": sorted(asked.levels),
        "most_drives": asked.drives,
        "machine": machine(),
        "commits": sorted({str(d["commit"]) for tested in tests for d in tested.drives}),
        "certified": {f"{risk:g}": level for risk, level in sorted(certified.items())},
        "levels": [_summary(tested) for tested in tests],
    }
    write_results(out / "calibration.json", KIND, found)
    return found


def _test(
    settings: Settings,
    asked: CalibrateSettings,
    level: float,
    risks: Sequence[float],
    out: Path,
    jobs: int,
) -> Tested:
    """Drive at a level until it is clear for each risk whether it is certified."""
    wanted = 1.0 / (1.0 - asked.confidence)
    settings = replace(settings, seed=asked.seed, level=level, arms=(ARM,), episodes=asked.drives)
    weights = fingerprint_of(load_predictor(settings.predictor))
    told = {k: v for k, v in asdict(settings).items() if k != "arms"} | {"weights": weights}
    told = json.loads(json.dumps(told))
    file = DriveFile(out / f"level-{level:g}.json", KINDS, told, grows="episodes")

    def decided() -> bool:
        drives = _in_order(file, asked.drives)
        return all(_end(drives, risk, asked.drives, wanted) is not None for risk in risks)

    work = partial(_driven, settings, weights)
    file.fill(work, range(asked.drives), jobs, lambda d: str(d["outcome"]), decided)
    drives = _in_order(file, asked.drives)
    # As many as the slowest decision took: how many workers there were decides nothing.
    ends = [_end(drives, risk, asked.drives, wanted) for risk in risks]
    drives = drives[: max(len(drives) if end is None else end for end in ends)]
    if not drives:
        raise UsageError("--world: no drive is possible in these buildings")
    if any(drive["learned"] for drive in drives):
        raise UsageError("the predictor has learned from these buildings: choose another --seed")
    losses = _losses(drives)
    return Tested(level, drives, {risk: capital(losses, risk) for risk in risks})


def _end(drives: list[dict[str, Any]], risk: float, most: int, wanted: float) -> int | None:
    """Return after how many drives it is clear whether a risk is certified; None: it is not yet.

    It is clear when the gambler is convinced, or when no drive still to come could do that.
    """
    money = capital(_losses(drives), risk)
    best = money * (1.0 + risk / (1.0 - risk)) ** (most - 1.0 - np.arange(len(money)))
    clear = (money >= wanted) | (best < wanted)
    return int(np.argmax(clear)) + 1 if clear.any() else None


def _losses(drives: list[dict[str, Any]]) -> list[float]:
    return [float(drive["outcome"] == "collided") for drive in drives]


def _in_order(file: DriveFile, most: int) -> list[dict[str, Any]]:
    """Return the drives up to the first that is missing, without those that had no task."""
    there = takewhile(lambda index: index in file.drives, range(most))
    drives = [file.drives[index] for index in there]
    return [drive for drive in drives if drive["outcome"] != "no task"]


def _driven(settings: Settings, weights: str | None, index: int) -> dict[str, Any]:
    """Drive once, and return what the file of drives holds of it.

    The building is drawn at random: were its kind the same at every n-th drive, the drives would
    not be draws from the mixture one after the other, as the test wants them.
    """
    places, seed = sources(settings.world), settings.seed + index
    place = places[int(np.random.default_rng([seed, 3]).integers(len(places)))]
    told = {"index": index, "place": Path(place).stem}
    one = replace(settings, world=(place,), seed=seed, episodes=1)
    driven = attempt(one, weights, (0, ARM))
    if isinstance(driven, str):
        return told | {"outcome": "no task", "note": driven}
    result, _ = driven
    return told | {name: getattr(result, name) for name in KEPT}


def _summary(tested: Tested) -> dict[str, Any]:
    """Return what calibration.json holds of a level."""
    drives = tested.drives
    outcomes = Counter(d["outcome"] for d in drives)
    places = Counter(d["place"] for d in drives)
    bad = Counter(d["place"] for d in drives if d["outcome"] == "collided")
    metres, seconds = (sum(d[name] for d in drives) for name in ("path_length", "time"))
    return {
        "level": tested.level,
        "drives": len(drives),
        "collided": outcomes["collided"],
        "nominal_interval": list(wilson(outcomes["collided"], len(drives))),
        "km": metres / 1e3,
        "outcomes": dict(outcomes),
        "by_world": {place: [bad[place], places[place]] for place in sorted(places)},
        "capital": {f"{risk:g}": float(one.max()) for risk, one in tested.capital.items()},
        "speed": metres / seconds if seconds else None,
    }


def table_of_drives(found: dict[str, Any]) -> str:
    """Return the drives at one level as Markdown."""
    drives = [drive for drive in found["drives"] if drive["outcome"] != "no task"]
    tested = Tested(found["settings"]["level"], drives, {})
    return table({"levels": [_summary(tested)], "certified": {}})


def table(found: dict[str, Any]) -> str:
    """Return a calibration as Markdown: a line for each level.

    The intervals are nominal, since the number of drives depends on their outcomes.
    """
    certified = {float(risk): level for risk, level in found["certified"].items()}
    rows = []
    for entry in found["levels"]:
        risks = [f"{risk:g}" for risk, level in certified.items() if level >= entry["level"]]
        low, high = entry["nominal_interval"]
        rows.append(
            {
                "level λ": f"{entry['level']:g}",
                "drives": entry["drives"],
                "collided": entry["collided"],
                "nominal 95 % interval": f"{100 * low:.1f}–{100 * high:.1f} %",
                "km": f"{entry['km']:.1f}",
                "speed [m/s]": f"{entry['speed']:.2f}" if entry["speed"] else DASH,
                "certified for δ": ", ".join(risks) or "–",
            }
        )
    return records(rows)
