"""The drives of the study of errors: its cases, and how each is driven."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from benchmarks.runs.arms import ARMS
from benchmarks.runs.car import limits_for
from benchmarks.runs.drive import drive
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.driver import navigator_for, predictor_for
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task
from benchmarks.studies.robustness.among_people import CrowdedLidar, first_touch
from benchmarks.studies.robustness.hostile_drives import driven
from benchmarks.studies.robustness.late_predictor import LateAsker
from benchmarks.studies.robustness.scenario import Scenario
from benchmarks.studies.robustness.worst_errors import MOST, WorstErrors
from foresee.infra.environment import commit
from foresee.mapping.conventions import NOISE_CUT
from foresee.mapping.family_names import FAMILIES
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import Episode, EpisodeConfig, run_episode
from sim.people import APART, People
from sim.task import NoTaskError

TOLD = {
    "delay": 0.1,
    "jitter": 0.02,
    "lag": 0.05,
    "pose_error": 0.02,
    "yaw_error": 0.005,
    "noise": 0.01 / NOISE_CUT,
}
"""Errors that the navigator is told beyond the bounds, one at a time; units as in `Settings`."""
FACTORS = (0.0, 1.0, 1.5, 2.0, 3.0, 5.0)
"""Ratios of the true error to the one that is told."""
SECONDS, SPEED = 15.0, 4.0
"""Longest duration [s], in simulated time, and top speed [m/s] of a drive beyond the bounds."""
LIE = "free, confidence 1.0"
"""Predictor of these drives, which makes the car fast: all is free."""
COSTS = (
    *({"delay": delay} for delay in (0.0, 0.1, 0.2, 0.3)),
    *({"pose_error": error} for error in (0.02, 0.05)),
    *({name: most} for name, most in MOST.items() if name not in ("delay", "pose_error")),
)
"""Errors whose cost is measured: none, delays, errors of the position, and of each other error the
largest value in the attack."""
PLACES = ("corridor", "office")
"""Families in which it is measured."""
LATE = (0, 1, 2, 5, 10)
"""Numbers of ticks by which predictions are late."""
DENSITY, WALK = 0.05, 1.4
"""People per area of floor [1/m²] and their walking speed [m/s]."""


@cache
def cases_of(part: str) -> Sequence[dict[str, Any]]:
    """Return the cases of a part of the study; each is driven in every building."""
    match part:
        case "beyond":
            return [{"setting": setting, "factor": f} for setting, f in product(TOLD, FACTORS)]
        case "cost":
            return [
                {"family": family, "arm": arm, "error": error}
                for family, arm, error in product(PLACES, ("known", "predicted"), COSTS)
            ]
        case "late":
            return [
                {"family": family, "arm": arm, "ticks": ticks}
                for family in PLACES
                for arm, ticks in (("known", 0), *(("predicted", ticks) for ticks in LATE))
            ]
    return [
        {"v_max": v_max, "apart": apart} for v_max, apart in product((2.0, 4.0, 6.0), (APART, 0.0))
    ]


def driven_case(part: str, seed: int, index: int) -> dict[str, Any]:
    """Drive one case in one building, and return the entry of the drive in the results.

    Args:
        part: part of the study.
        seed: seed of the first building.
        index: number of the drive: all cases of a building follow one another.
    """
    cases = cases_of(part)
    building, number = divmod(index, len(cases))
    case = cases[number]
    entry = {"index": index, "building": building, "commit": commit(), **case}
    works: dict[str, Callable[..., dict[str, Any]]]
    works = {"beyond": _beyond, "cost": _cost, "late": _late, "people": _among_people}
    try:
        return entry | works[part](seed + building, **case)
    except NoTaskError as error:
        return entry | {"outcome": NO_TASK, "note": str(error)}


def _beyond(seed: int, setting: str, factor: float) -> dict[str, Any]:
    """Drive with one error that is a multiple of what the navigator is told."""
    given: dict[str, Any] = {setting: factor * TOLD[setting], f"told_{setting}": TOLD[setting]}
    family = FAMILIES[seed % len(FAMILIES)]
    settings = Settings(
        world=(family,), seed=seed, arms=("predicted",), v_max=SPEED, predictor="none", **given
    )
    rng = np.random.default_rng([seed, 5])
    scenario = Scenario(
        seed, LIE, "usual", (), settings, car=limits_for(settings), worst=WorstErrors.draw(rng)
    )
    drawn = {"family": family, "worst": asdict(scenario.worst) if scenario.worst else None}
    return drawn | driven(scenario, make_task(settings, 0), SECONDS)


def _cost(seed: int, family: str, arm: str, error: dict[str, float]) -> dict[str, Any]:
    """Drive to the goal with errors that the navigator is told."""
    given: dict[str, Any] = error
    settings = Settings(world=(family,), route="fixed", seed=seed, arms=(arm,), **given)
    return _measures(drive(settings, 0, arm).result)


def _late(seed: int, family: str, arm: str, ticks: int) -> dict[str, Any]:
    """Drive to the goal with predictions that come some ticks late."""
    settings = Settings(world=(family,), route="fixed", seed=seed, arms=(arm,))
    task, limits = make_task(settings, 0), limits_for(settings)
    predictor = predictor_for(settings, ARMS[arm], task)
    asker = None if predictor is None else LateAsker(predictor, ticks)
    driver = navigator_for(settings, ARMS[arm], task, asker, 600.0)
    rng = np.random.default_rng([seed, 2])
    return _measures(run_episode(task, driver, DubinsCar(limits), Lidar(), EpisodeConfig(), rng))


def _measures(drive: DriveResult | Episode) -> dict[str, Any]:
    """Return the measures of a drive that the tables need."""
    names = ("outcome", "time", "mean_speed", "min_clearance", "faults")
    return {name: getattr(drive, name) for name in names} | {"outcome": str(drive.outcome)}


def _among_people(seed: int, v_max: float, apart: float) -> dict[str, Any]:
    """Drive in a corridor with people, until the drive ends."""
    settings = Settings(world=("corridor",), route="fixed", seed=seed, v_max=v_max)
    task, arm, limits = make_task(settings, 0), ARMS["predicted"], limits_for(settings)
    driver = navigator_for(settings, arm, task, predictor_for(settings, arm, task), 600.0)
    rng, crowd = np.random.default_rng([seed, 2]), np.random.default_rng([seed, 3])
    people = People(
        task.world, DENSITY, np.array(task.start[:2]), crowd, speeds=(WALK, WALK), apart=apart
    )
    lidar = CrowdedLidar(LidarConfig(), people)
    episode = run_episode(task, driver, DubinsCar(limits), lidar, EpisodeConfig(), rng)
    states, places = episode.trace["states"][:-1], np.array(lidar.places)
    touch = first_touch(states, places, limits.body)
    return {
        "outcome": str(episode.outcome),
        "people": len(people.places),
        "seconds": touch["at"] if touch else episode.time,
        "touch": touch,
    }
