"""Times of the control cycle on the wall clock, with path searches beside it and other load."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings
from benchmarks.studies.performance.stage_times import WARM_UP, Measure, measure
from foresee.infra.workers import follow_parent

ARM = "predicted"
"""Arm that drives."""
STAGES = {"cycle": "cycle", "predict": "wait for the prediction", "mpc": "MPC and last resort"}
"""Stages that are reported, and how they are called."""


def beside(drives: int, seed: int, report: Callable[[str], None]) -> dict[str, Measure]:
    """Measure the control cycle in drives on the wall clock, and count late controls.

    The search for paths and the predictor run in processes of their own, on the same cores.

    Args:
        drives: number of drives in each condition; one before them is not counted.
        seed: seed of the first drive.
        report: function that shows the progress.
    """
    cores = sorted(os.sched_getaffinity(0))[-2:]
    conditions = {
        "one core": (cores[-1:], 0),
        "two cores": (cores, 0),
        "two cores, each with other work": (cores, len(cores)),
    }
    measures: dict[str, Measure] = {}
    for name, (own, busy) in conditions.items():
        report(f"cycle on {name}")
        with _load(own[:busy]):
            times, late = _on_cores(drives, seed, own)
        for stage, meaning in STAGES.items():
            p50, p99 = np.percentile(times[stage], [50, 99])
            measures[f"{meaning} on the wall clock, {name}"] = measure(
                float(p50), "ms", len(times[stage]), p99=float(p99)
            )
        measures[f"late controls, {name}"] = measure(float(late), "ticks", len(times["cycle"]))
    return measures


def _on_cores(drives: int, seed: int, cores: list[int]) -> tuple[dict[str, list[float]], int]:
    """Return the times of each stage [ms] and the number of late ticks of drives on some cores."""
    # A new process, whose own processes of search and prediction start on these cores, too.
    with ProcessPoolExecutor(1, get_context("spawn"), _begin, (os.getpid(), cores)) as pool:
        return pool.submit(_drive_all, drives, seed).result()


def _begin(parent: int, cores: list[int]) -> None:
    follow_parent(parent)
    os.sched_setaffinity(0, cores)


def _drive_all(drives: int, seed: int) -> tuple[dict[str, list[float]], int]:
    settings = Settings(arms=(ARM,), seed=seed, real_time=True)
    drive(settings, 0, ARM)
    times: dict[str, list[float]] = {stage: [] for stage in STAGES}
    late = 0
    for index in range(drives):
        driven = drive(settings, index, ARM)
        counted = driven.trace.stage_times(WARM_UP)
        for stage, taken in times.items():
            taken.extend(counted[stage].tolist())
        late += driven.result.late_ticks or 0
    return times, late


@contextmanager
def _load(cores: list[int]) -> Iterator[None]:
    """Keep some cores busy with a process each, in this context."""
    context = get_context("spawn")
    busy = [context.Process(target=_spin, args=(os.getpid(), core), daemon=True) for core in cores]
    for process in busy:
        process.start()
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.join()


def _spin(parent: int, core: int) -> None:
    _begin(parent, [core])
    while True:
        pass
