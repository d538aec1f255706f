"""One drive of a race: an entry in one building of a suite."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.race.entry import Entry, load_driver
from benchmarks.runs.drive import drive, result_of
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import Settings
from benchmarks.runs.trace import Trace
from foresee.infra.workers import WorkersError
from sim import DubinsCar, Lidar
from sim.controller import ControllerDriver, ControllerError
from sim.episode import EpisodeConfig, run_episode
from sim.suite import Suite
from sim.task import Task


def race_drive(suite_name: str, entry: Entry, index: int) -> dict[str, Any]:
    """Drive in one building of a suite.

    Args:
        suite_name: name of the suite.
        entry: what drives.
        index: number of the building.

    Returns:
        The fields of a `DriveResult`, and `map`, the hash of the true map.

    Raises:
        SuiteError: if this version draws another building than the suite has.
        ControllerError: if a driver raises an error or returns no proper control.
        PlugInError, PredictorError: if what drives cannot be loaded.
        WorkersError: if what drives has changed since the race began.
    """
    present = Entry.load(entry.kind, entry.of).fingerprint
    if present != entry.fingerprint:
        raise WorkersError(
            f"{entry.of} has changed: it is {present}, the race is of {entry.fingerprint}"
        )
    suite = Suite.read(suite_name)
    task = suite.task(index)
    settings = settings_of(suite, entry, index)
    try:
        if entry.kind == "driver":
            result = _drive_own(suite, settings, entry, index, task)
        else:
            result = drive(settings, index, entry.arm, task).result
    except ControllerError as error:
        raise ControllerError(f"building {index}: {error}") from error
    return {"map": suite.places[index].map} | asdict(result)


def settings_of(suite: Suite, entry: Entry, index: int) -> Settings:
    """Return the settings with which `foresee corridor` would make a drive of a race."""
    place = suite.places[index]
    return Settings(
        world=(place.family,),
        seed=place.seed,
        episodes=1,
        route=suite.route,
        window=suite.window,
        v_max=suite.v_max,
        vehicle="reeds-shepp" if suite.reverse else "dubins",
        reverse=suite.car.reverse or Settings.reverse,
        arms=(entry.arm,),
        predictor=entry.predictor,
        risk=entry.risk,
        uncertified=entry.uncertified,
        level=entry.level,
        calibrated=entry.calibrated,
    )


def _drive_own(
    suite: Suite, settings: Settings, entry: Entry, index: int, task: Task
) -> DriveResult:
    """Drive with a driver of one's own, with the scans and the noise of all other entries."""
    driver = ControllerDriver(
        load_driver(entry.of), task, suite.car, suite.window, suite.route == "fixed"
    )
    rng = np.random.default_rng([task.seed, 2])
    config = EpisodeConfig(goal_radius=task.rules.goal_radius)
    episode = run_episode(task, driver, DubinsCar(suite.car), Lidar(), config, rng)
    trace = Trace.of(task, index, entry.of, episode.trace)
    return result_of(settings, index, entry.of, task, episode, trace, learned=False)
