"""Drives with hostile predictors, in all families of buildings and in unusual situations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from itertools import repeat
from typing import Any

import numpy as np

from benchmarks.runs.arms import ARMS
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.driver import navigator_for
from benchmarks.studies.contact_test import touches
from benchmarks.studies.robustness.hostile_predictors import (
    CLASSES,
    DEADLINE,
    hostile,
)
from benchmarks.studies.robustness.scenario import HONEST, SITUATIONS, Scenario
from benchmarks.studies.robustness.witness import Witness
from benchmarks.studies.robustness.worst_errors import (
    MOST,
    POSES,
    RANGES,
    TIMES,
    YAWS,
    TracedCar,
)
from foresee.infra.environment import commit
from foresee.infra.markdown import DASH, records
from foresee.prediction import Predictor
from planner.decision import Decision
from planner.fault import Fault
from planner.risk.predictor_process import PredictorProcess
from predictor.registry import load_predictor
from sim.episode import EpisodeConfig, run_episode
from sim.task import NoTaskError, Task

TITLES = {
    "usual": "as in comparisons",
    "cells": "cells of 0.01–0.5 m",
    "thin walls": "walls of one cell",
    "body": "other bodies and turning radii",
    "pocket": "the car must back out at the start",
    "lattice": "start and beams in corners of cells",
    "process": "predictor in a process of its own",
    "goals": "new goals on the drive",
    "mixed": "several of these",
}
"""Situation → its description in the table."""
NEW_GOAL = 0.1
"""Probability of a new goal in a tick of a drive with new goals."""
HONEST_SECONDS = 30.0
"""Longest duration of a drive with an honest predictor, in simulated time [s]."""
Drives = list[dict[str, Any]]
BROKEN = (Fault.EMERGENCY, Fault.NO_LAST_RESORT)
"""Faults that the guarantee excludes."""


def attacked(
    seed: int, seconds: float, index: int, errors: bool = False, maps: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Drive once with a hostile predictor, and return the entry of the drive in the results.

    An exception that reaches this function is recorded as `error`.

    Args:
        seed: seed of the first building.
        seconds: longest duration of the drive in simulated time [s].
        index: number of the drive.
        errors: whether the robot has errors; then some predictors are honest.
        maps: map files of real buildings, for drives with errors.
    """
    scenario = Scenario.draw(index, seed, errors, maps)
    settings, car = scenario.settings, scenario.car
    entry: dict[str, Any] = {
        "index": index,
        "kind": scenario.kind,
        "situation": scenario.situation,
        "odd": list(scenario.odd),
        "world": settings.world[0],
        **{k: getattr(settings, k) for k in ("seed", "route", "vehicle", "reliance", "v_max")},
        "resolution": scenario.resolution,
        "body": [car.body.length, car.body.width],
        "turning_radius": car.turning_radius,
        "commit": commit(),
    }
    if scenario.worst is not None:
        entry["errors"] = {name: getattr(settings, name) for name in MOST}
        entry["worst"] = asdict(scenario.worst)
    try:
        task = scenario.task()
    except NoTaskError as error:
        return entry | {"outcome": NO_TASK, "error": None, "note": str(error)}
    found = entry | driven(scenario, task, seconds)
    if scenario.honest:
        # Some tasks are too hard without errors, too.
        found["without_errors"] = driven(scenario.without_errors(), task, seconds)["outcome"]
    return found


def driven(scenario: Scenario, task: Task, seconds: float) -> dict[str, Any]:
    """Drive once, judge the drive, and return what happened.

    Args:
        scenario: predictor, car and errors.
        task: task of the drive.
        seconds: longest duration in simulated time [s]; with an honest predictor it is longer.
    """
    settings, body = scenario.settings, scenario.car.body
    witness, lidar = Witness(task.world), scenario.lidar
    limit, deadline = (HONEST_SECONDS, 600.0) if scenario.honest else (seconds, DEADLINE)
    rng = np.random.default_rng([task.seed, 2])
    car = TracedCar(scenario.car, task.start)
    try:
        with _predictor(scenario) as predictor:
            driver = navigator_for(
                settings, ARMS[settings.arms[0]], task, predictor, deadline, car=scenario.car
            )
            goals = _goals(task) if "goals" in scenario.odd else repeat(None)

            def watch(_: Any, decision: Decision) -> None:
                witness.compare(driver.known, *decision.plan.states[0, :2])
                goal = next(goals)
                if goal is not None:
                    driver.head_for(goal)

            episode = run_episode(
                task,
                driver,
                car,
                lidar,
                EpisodeConfig(timeout=limit * settings.v_max / task.path_length),
                rng,
                watch,
                scenario.robot(task.world, rng),
            )
    except Exception as error:
        # The program must survive every hostile predictor: an exception here is a failure.
        return {"outcome": "crashed", "error": f"{type(error).__name__}: {error}"}
    if "lattice" in scenario.odd and scenario.worst is None:
        witness.scan_from_corners(lidar, rng)
    world, trace = task.world, episode.trace
    false = witness.false_cells
    if scenario.worst is not None:
        # A wall may seem to stand where none is, but nothing solid may seem free.
        false = {name: n for name, n in false.items() if name == "solid_as_free"}
    return {
        "outcome": str(episode.outcome),
        "touched": touches(np.array(car.states), world.solid, world.grid.frame, body),
        "false_cells": false,
        "error": None,
        "time": round(episode.time, 1),
        "path_length": round(episode.path_length, 2),
        "reversed": round(_reversed(trace["states"]), 2),
        "turned": round(_turned(trace["states"]), 2),
        "max_speed": round(episode.max_speed, 2),
        "min_clearance": round(episode.min_clearance, 3),
        "impact_speed": episode.impact_speed,
        "ticks": len(trace["kept"]),
        "faults": episode.faults,
        "longest_wait": _longest_wait(trace),
    }


def _goals(task: Task) -> Iterator[tuple[float, float] | None]:
    """Yield, in each tick, a new goal in a free cell of the building [m], or None."""
    rng, grid = np.random.default_rng([task.seed, 5]), task.world.grid
    xs, ys = grid.frame.centres()
    rows, cols = np.nonzero(grid.free)
    while True:
        number = int(rng.integers(len(rows)))
        goal = (float(xs[cols[number]]), float(ys[rows[number]]))
        yield goal if rng.random() < NEW_GOAL else None


@contextmanager
def _predictor(scenario: Scenario) -> Iterator[Predictor | None]:
    if scenario.honest:
        yield load_predictor(scenario.kind)
        return
    if "process" not in scenario.odd:
        yield hostile(scenario.kind)
        return
    process = PredictorProcess(hostile, scenario.kind)
    try:
        yield process
    finally:
        process.close()


def _reversed(states: Any) -> float:
    """Return the distance driven in reverse [m]."""
    steps = np.hypot(*np.diff(states[:, :2], axis=0).T)
    return float(steps[states[1:, 3] + states[:-1, 3] < 0.0].sum())


def _turned(states: Any) -> float:
    """Return the angle turned on the spot [rad]."""
    steps = np.hypot(*np.diff(states[:, :2], axis=0).T)
    angles = np.abs(np.remainder(np.diff(states[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)
    return float(angles[steps == 0.0].sum())


def _longest_wait(trace: dict[str, Any]) -> int:
    """Return the longest wait for a prediction after the first tick [ms]."""
    names = trace["time_names"].tolist()
    waits = trace["times"][1:, names.index("predict")] if "predict" in names else np.zeros(0)
    return round(float(waits.max(initial=0.0)))


def failures(drives: Drives) -> Iterator[str]:
    """Yield a line for each drive that should not have ended so."""
    for drive in drives:
        if drive["outcome"] == NO_TASK:
            continue
        wrong = [drive["outcome"]] if drive["outcome"] in ("collided", "crashed") else []
        wrong += ["touched"] if drive.get("touched") else []
        wrong += [f"{name} {n}" for name, n in drive.get("false_cells", {}).items() if n]
        wrong += [f"{fault} {n}" for fault, n in drive.get("faults", {}).items() if fault in BROKEN]
        if wrong:
            what = f"drive {drive['index']}, {drive['situation']}, {drive['kind']}"
            yield f"{what}: {', '.join(wrong)} {drive['error'] or ''}".rstrip()


def table(results: dict[str, Any]) -> str:
    """Return drives, contacts and faults by class of predictors and by situation as Markdown."""
    drives = [d for d in results["drives"] if d["outcome"] != NO_TASK]
    by_class = {
        what: [d for d in drives if d["kind"] in kinds]
        for what, kinds in (CLASSES | {"honest": HONEST}).items()
    } | {"all": drives}
    by_situation = {
        TITLES[name]: [d for d in drives if d["situation"] == name] for name in SITUATIONS
    } | {"all": drives}
    parts = {"predictors": by_class, "situation": by_situation, "error": _by_error(drives)}
    parts = {head: groups for head, groups in parts.items() if groups}
    tables = [records(list(_rows(head, groups))) for head, groups in parts.items()]
    tables += [records([reached(drives)])] if any("without_errors" in d for d in drives) else []
    return "\n\n".join(tables)


def _by_error(drives: Drives) -> dict[str, Drives]:
    """Return the drives with each way of being wrong."""
    ways = [("pose", POSES), ("yaw", YAWS), ("time", TIMES), ("range", RANGES)]
    among = [d for d in drives if "worst" in d]
    of = {"pose": "pose_error", "yaw": "yaw_error", "time": "jitter", "range": "noise"}
    return {
        f"{name}: {way}": found
        for name, them in ways
        for way in them
        if (found := [d for d in among if d["worst"][name] == way and d["errors"][of[name]]])
    } | {
        name: found
        for name in ("delay", "lag", "dropout", "missed")
        if (found := [d for d in among if d["errors"][name]])
    }


def reached(drives: Drives) -> dict[str, Any]:
    """Count how many of the drives with honest predictors reached their goal, with and without."""
    honest = [d for d in drives if "without_errors" in d]
    both = Counter((d["outcome"] == "reached", d["without_errors"] == "reached") for d in honest)
    return {
        "honest drives": len(honest),
        "reached with errors": both[True, True] + both[True, False],
        "reached without": both[True, True] + both[False, True],
        "reached only without": both[False, True],
        "reached only with": both[True, False],
    }


def _rows(head: str, groups: dict[str, Drives]) -> Iterator[dict[str, Any]]:
    """Yield a row for each group of drives that is not empty."""
    for name, drives in groups.items():
        whole = [d for d in drives if d["outcome"] != "crashed"]
        if not drives:
            continue
        seconds, metres = (sum(d[key] for d in whole) for key in ("time", "path_length"))
        yield {
            head: name,
            "drives": len(drives),
            "collided": sum(d["outcome"] == "collided" for d in drives),
            "exact body touched": sum(d["touched"] for d in whole),
            "false observations": sum(any(d["false_cells"].values()) for d in whole),
            "emergencies": sum(any(fault in d["faults"] for fault in BROKEN) for d in whole),
            "program errors": len(drives) - len(whole),
            "mean speed [m/s]": f"{metres / seconds:.2f}" if seconds else DASH,
            "faults per drive": _mean(_faults, whole),
        }


def _mean(of: Callable[[dict[str, Any]], int], drives: Drives) -> str:
    return f"{sum(map(of, drives)) / max(1, len(drives)):.0f}"


def _faults(drive: dict[str, Any]) -> int:
    """Return the number of faults of the predictor in a drive."""
    return sum(n for fault, n in drive["faults"].items() if fault.startswith("predictor"))
