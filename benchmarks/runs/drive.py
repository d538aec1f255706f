"""One drive of a comparison: from the number of an episode and an arm to its result and trace."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from typing import Any

import numpy as np

from benchmarks.optimal.shortest_path import time_bound
from benchmarks.runs.arms import ARMS, arm_kind
from benchmarks.runs.beliefs import Beliefs
from benchmarks.runs.car import limits_for
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.driver import navigator_for, predictor_for
from benchmarks.runs.moment import Moment
from benchmarks.runs.settings import REAL_DEADLINE, Settings
from benchmarks.runs.tasks import (
    limit_speed,
    make_task,
    refuse_edited_inputs,
    shortest_length,
    task_facts,
)
from benchmarks.runs.trace import Drive, Trace
from foresee.infra.environment import commit
from foresee.infra.workers import WorkersError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import GOAL_RADIUS, TICK
from planner.decision import Decision
from planner.fault import Fault
from planner.guide.search_process import SearchProcess
from planner.revision import revision_of
from planner.risk.predictor_process import PredictorProcess
from predictor.provenance import has_learned, weights_fingerprint
from predictor.registry import fingerprint_of, load_frontiers, load_predictor
from sim import DubinsCar, Lidar, LidarConfig
from sim.buildings import learned_forms
from sim.episode import Episode, EpisodeConfig, Outcome, run_episode
from sim.errors import Errors, Robot
from sim.task import NoTaskError, Task
from sim.wall_clock import OnWallClock

MEASURES = ("time", "path_length", "mean_speed", "max_speed", "min_clearance")
"""Measures that are copied from `sim.episode.Episode` into the result."""


def score(
    outcome: str,
    time: float,
    path_length: float,
    shortest: float | None,
    car: CarLimits,
    goal_radius: float = GOAL_RADIUS,
) -> dict[str, float | None]:
    """Compare a drive with the shortest path of its task, and with the least time for that path.

    Args:
        outcome: outcome of the drive; the SCT is 0 unless it is "reached".
        time: duration of the drive [s].
        path_length: distance driven [m].
        shortest: length of the shortest path [m]; None: unknown.
        car: limits of the car.
        goal_radius: distance from the goal within which it is reached [m].

    Returns:
        `shortest_length` [m]; `t_bound`, the least time T_bound [s]; `sct`, T_bound / time or 0;
        `detour`, the distance driven divided by the shortest path. All are None if the shortest
        path is not known.
    """
    if shortest is None:
        return dict.fromkeys(("shortest_length", "t_bound", "sct", "detour"))
    bound = time_bound(shortest, car, goal_radius)
    return {
        "shortest_length": shortest,
        "t_bound": bound,
        "sct": bound / time if outcome == Outcome.REACHED else 0.0,
        "detour": path_length / shortest,
    }


def run_fingerprint(settings: Settings) -> str | None:
    """Return the fingerprints of a run's predictors, see `fingerprint_of`; None if there are none.

    That of the chosen predictor always counts, that of the frontiers only if an arm uses them.

    Raises:
        PredictorError: if a predictor cannot be loaded.
    """
    fingerprints = [fingerprint_of(settings.predictor)]
    if any(ARMS[arm_kind(arm)].frontiers for arm in settings.arms):
        fingerprints.append(weights_fingerprint(load_frontiers(settings.frontiers)))
    return " and ".join(filter(None, fingerprints)) or None


def attempt(
    settings: Settings,
    weights: str | None,
    item: tuple[int, str],
    maps: Mapping[str, str] | None = None,
) -> Drive | str:
    """Return what `drive` returns, or one line that says why the episode has no task.

    Args:
        settings: settings of the run.
        weights: what `run_fingerprint` returns where the run was started; another machine may have
            other files.
        item: number of the episode, and name of the arm.
        maps: hash of each map file, and of the file of given tasks, where the run was started;
            None: not checked.

    Raises:
        WorkersError: if this machine has other weights, another map or other given tasks.
    """
    present = run_fingerprint(settings)
    if present != weights:
        raise WorkersError(f"a worker has the weights {present}, this run is of {weights}")
    try:
        refuse_edited_inputs(settings, item[0], maps or {})
        return drive(settings, *item)
    except NoTaskError as error:
        return str(error)


def attempt_arm(
    arms: Mapping[str, Settings],
    weights: str | None,
    item: tuple[int, str],
    maps: Mapping[str, str] | None = None,
) -> Drive | str:
    """Return what `attempt` returns, with the settings of the arm.

    Args:
        arms: settings of each arm's drives, see `benchmarks.calibration.certificate.arms_at`.
        weights: as in `attempt`.
        item: as in `attempt`.
        maps: as in `attempt`.
    """
    return attempt(arms[item[1]], weights, item, maps)


@cache
def _search_process() -> SearchProcess:
    """Return the process of path searches, which all drives of this process use."""
    return SearchProcess()


@cache
def _predictor_process(name: str) -> PredictorProcess:
    """Return the process of a predictor, which all drives of this process use."""
    return PredictorProcess(load_predictor, name)


def drive(settings: Settings, index: int, arm_name: str, task: Task | None = None) -> Drive:
    """Drive one episode with one arm, and return its result and trace.

    Args:
        settings: settings of the run.
        index: number of the episode.
        arm_name: name of the arm.
        task: task to drive; None: that of the episode.

    Raises:
        NoTaskError: if the episode has no task.
    """
    task = task or make_task(settings, index)
    rules = task.rules
    settings = limit_speed(settings, [rules])
    arm = ARMS[arm_kind(arm_name)]
    car = limits_for(settings)
    predictor = predictor_for(settings, arm, task)
    frontiers = load_frontiers(settings.frontiers) if arm.frontiers else None
    at_risk = arm.takes_risk and settings.risk > 0
    asked, executor = predictor, None
    # By default a long one, so that the result does not depend on the load of the machine.
    deadline = settings.deadline or (REAL_DEADLINE if settings.real_time else 600.0)
    if settings.real_time:
        executor = _search_process()
        if arm.predictor == "chosen":
            asked = _predictor_process(settings.predictor)
    navigator = navigator_for(settings, arm, task, asked, deadline, frontiers, executor=executor)
    on_clock = OnWallClock(navigator, TICK) if settings.real_time else None
    lidar = Lidar(LidarConfig(range_noise=settings.noise, dropout=settings.dropout))
    # Seeded by the task, so that an episode does not depend on its number in a run.
    rng = np.random.default_rng([task.seed, 2])
    moment, beliefs = Moment(), Beliefs(task.world.grid.frame)
    config = EpisodeConfig(goal_radius=rules.goal_radius, time_limit=rules.time_limit)
    robot = Robot(Errors(settings.bounds, settings.missed), rng)

    def observe(tick: int, decision: Decision) -> None:
        moment.observe(tick, decision)
        beliefs.observe(decision)

    episode = run_episode(
        task, on_clock or navigator, DubinsCar(car), lidar, config, rng, observe, robot
    )
    _give_back()
    trace = Trace.of(task, index, arm_name, episode.trace | moment.arrays() | beliefs.arrays())
    result = result_of(
        settings,
        index,
        arm_name,
        task,
        episode,
        trace,
        learned=any(has_learned(p, learned_forms(task.world)) for p in (predictor, frontiers)),
        level=settings.level if arm.takes_risk else None,
        calibrated=settings.calibrated if at_risk else None,
        uncertified=settings.uncertified and at_risk,
        late_ticks=None if on_clock is None else on_clock.late,
        late_predictions=(
            navigator.faults[Fault.PREDICTOR_LATE]
            if settings.real_time or settings.deadline is not None
            else None
        ),
    )
    return Drive(result, trace)


def result_of(
    settings: Settings,
    index: int,
    arm_name: str,
    task: Task,
    episode: Episode,
    trace: Trace,
    **more: Any,
) -> DriveResult:
    """Return the measures of a drive that has ended.

    Args:
        settings: settings of the drive.
        index: number of the episode.
        arm_name: name of the arm.
        task: task that was driven.
        episode: the drive.
        trace: its trace.
        more: fields of the result that only the driver knows.
    """
    car, rules = limits_for(settings), task.rules
    measured: dict[str, Any] = {name: float(getattr(episode, name)) for name in MEASURES}
    shortest = shortest_length(task, car.body.half_width)
    measured |= score(
        episode.outcome, episode.time, episode.path_length, shortest, car, rules.goal_radius
    )
    return DriveResult(
        arm=arm_name,
        vehicle=settings.vehicle,
        index=index,
        **task_facts(task),
        **asdict(rules),
        shortest=float(task.path_length),
        outcome=str(episode.outcome),
        **measured,
        stops=int(episode.stops),
        hard_stops=int(episode.hard_stops),
        impact_speed=episode.impact_speed,
        promises=int((trace.kept >= 0).sum()),
        promises_broken=int((trace.kept == 0).sum()),
        ticks=len(trace.kept),
        faults={str(k): int(v) for k, v in episode.faults.items()},
        paths={str(k): int(v) for k, v in episode.paths.items()},
        # The commit on this machine, which may be another than that of the command.
        commit=commit(),
        revision=revision_of(settings.route),
        cycle_ms=np.percentile(trace.stage_times()["cycle"], [50, 99]).tolist(),
        **more,
    )


def _give_back() -> None:
    """Return freed memory to the operating system.

    Otherwise glibc keeps it in fragments, which are too small for the maps of the next building: a
    process grew by 0.5 MiB in each drive.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
