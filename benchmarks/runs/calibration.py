"""Learn-then-test: the largest level of the last resort whose collisions stay below a bound."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
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
from predictor.infra.environment import commit, machine
from predictor.infra.markdown import records
from predictor.infra.results_file import write_results
from predictor.provenance import fingerprint_of
from predictor.registry import load_predictor

ARM = "predicted"
KEPT = (
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
        UsageError: if the drives are too few for a risk, or the folder holds other ones.
    """
    wanted = 1.0 / (1.0 - asked.confidence)
    for risk in asked.risks:
        best = capital(np.zeros(asked.drives), risk)
        if best[-1] < wanted:
            raise UsageError(
                f"--drives {asked.drives} cannot certify a risk of {risk:g}, even if none collides"
            )
    open_risks, certified = list(asked.risks), dict[float, float]()
    tests: list[Tested] = []
    for level in sorted(asked.levels):
        if not open_risks:
            break
        print(f"level {level:g}")
        tested = _test(settings, asked, level, open_risks, out, jobs)
        tests.append(tested)
        for risk in list(open_risks):
            if (tested.capital[risk] >= wanted).any():
                certified[risk] = level
            else:
                open_risks.remove(risk)
    found = {
        "conditions": conditions_of(settings),
        "confidence": asked.confidence,
        "seed": asked.seed,
        "machine": machine(),
        "commit": commit(),
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
    told = asdict(settings) | {"weights": fingerprint_of(load_predictor(settings.predictor))}
    told.pop("arms")
    told = json.loads(json.dumps(told))
    file = DriveFile(out / f"level-{level:g}.json", "drives", told, grows="episodes")

    def capitals() -> dict[float, NDArray[np.float64]]:
        losses = [float(d["outcome"] == "collided") for d in _without_gaps(file)]
        return {risk: capital(losses, risk) for risk in risks}

    def enough() -> bool:
        return all(
            (money >= wanted).any() or _hopeless(money, risk, asked.drives, wanted)
            for risk, money in capitals().items()
        )

    work = partial(_driven, settings, told["weights"])
    file.fill(work, range(asked.drives), jobs, lambda d: str(d["outcome"]), enough)
    money = capitals()
    # A drive that was done out of its turn is not counted, so that the number of workers decides
    # nothing.
    needed = max(
        int(np.argmax(one >= wanted)) + 1 if (one >= wanted).any() else len(one)
        for one in money.values()
    )
    drives = _without_gaps(file)[:needed]
    return Tested(level, drives, {risk: one[:needed] for risk, one in money.items()})


def _without_gaps(file: DriveFile) -> list[dict[str, Any]]:
    """Return the drives up to the first that is missing, without those that had no task."""
    drives: list[dict[str, Any]] = []
    while (index := len(drives)) in file.drives:
        drives.append(file.drives[index])
    return [drive for drive in drives if drive["outcome"] != "no task"]


def _hopeless(money: NDArray[np.float64], risk: float, drives: int, wanted: float) -> bool:
    """Return whether no drive that is left to come could still convince the gambler."""
    now = float(money[-1]) if len(money) else 1.0
    return now * (1.0 + risk / (1.0 - risk)) ** (drives - len(money)) < wanted


def _driven(settings: Settings, weights: str | None, index: int) -> dict[str, Any]:
    """Drive once, and return what the file of drives holds of it."""
    places = sources(settings.world)
    told = {"index": index, "place": Path(places[index % len(places)]).stem}
    driven = attempt(settings, weights, (index, ARM))
    if isinstance(driven, str):
        return told | {"outcome": "no task", "note": driven}
    result, _ = driven
    return told | {name: getattr(result, name) for name in KEPT}


def _summary(tested: Tested) -> dict[str, Any]:
    """Return what calibration.json holds of a level."""
    drives = tested.drives
    km = sum(d["path_length"] for d in drives) / 1e3
    outcomes = Counter(d["outcome"] for d in drives)
    places = Counter(d["place"] for d in drives)
    bad = Counter(d["place"] for d in drives if d["outcome"] == "collided")
    return {
        "level": tested.level,
        "drives": len(drives),
        "collided": outcomes["collided"],
        "interval": list(wilson(outcomes["collided"], len(drives))),
        "km": round(km, 2),
        "outcomes": dict(outcomes),
        "by_world": {place: [bad[place], places[place]] for place in sorted(places)},
        "capital": {f"{risk:g}": float(one.max()) for risk, one in tested.capital.items()},
        "speed": sum(d["path_length"] for d in drives) / sum(d["time"] for d in drives),
    }


def table_of_drives(found: dict[str, Any]) -> str:
    """Return the drives at one level as Markdown."""
    tested = Tested(found["settings"]["level"], found["drives"], {})
    return table({"levels": [_summary(tested)], "certified": {}})


def table(found: dict[str, Any]) -> str:
    """Return a calibration as Markdown: a line for each level."""
    certified = {float(risk): level for risk, level in found["certified"].items()}
    rows = []
    for entry in found["levels"]:
        risks = [f"{risk:g}" for risk, level in certified.items() if level >= entry["level"]]
        low, high = entry["interval"]
        rows.append(
            {
                "level λ": f"{entry['level']:g}",
                "drives": entry["drives"],
                "collided": entry["collided"],
                "95 % interval": f"{100 * low:.1f}–{100 * high:.1f} %",
                "km": f"{entry['km']:.1f}",
                "speed [m/s]": f"{entry['speed']:.2f}",
                "certified for δ": ", ".join(risks) or "–",
            }
        )
    return records(rows)
