"""Throughput (simulated seconds per second) and memory of processes that only drive."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings
from benchmarks.studies.performance.stage_times import Measure, measure
from foresee.infra.workers import WorkersError, follow_parent
from sim.task import NoTaskError

Item = tuple[int, str]
"""Number of an episode, and name of an arm."""


@dataclass(frozen=True)
class Driven:
    """Time and memory of one drive.

    Attributes:
        simulated: duration of the drive in simulated time [s].
        wall: time that its computation took [s].
        peak: largest memory of the process so far [MiB].
    """

    simulated: float
    wall: float
    peak: float


def throughput(
    episodes: int, seed: int, jobs: int, report: Callable[[str], None]
) -> dict[str, Measure]:
    """Measure the simulated seconds per second and core, and the time of 1,000 episodes.

    Args:
        episodes: number of episodes, each driven by all arms.
        seed: seed of the first episode.
        jobs: number of processes that drive in parallel.
        report: function that shows the progress.
    """
    settings = Settings(seed=seed)
    items = [(index, arm) for index in range(episodes) for arm in settings.arms]
    drives = driven(settings, items, jobs, report)
    wall = sum(d.wall for d in drives)
    minutes = 1000 * len(settings.arms) * wall / len(drives) / jobs / 60
    by = f"{jobs} process{'es' if jobs > 1 else ''}"
    rate = sum(d.simulated for d in drives) / wall
    arms = len(settings.arms)
    return {
        f"throughput, {by}": measure(rate, "simulated s/s a core", len(drives)),
        f"1,000 episodes of {arms} arms, {by}": measure(minutes, "min", len(drives)),
    }


def memory(drives: int, seed: int, report: Callable[[str], None]) -> dict[str, Measure]:
    """Measure the largest memory of one process over many drives, each in another building.

    Args:
        drives: number of drives.
        seed: seed of the first building.
        report: function that shows the progress.
    """
    settings = Settings(seed=seed)
    items = [(i, settings.arms[i % len(settings.arms)]) for i in range(drives)]
    done = driven(settings, items, 1, report)
    return {"worker, peak memory": measure(max(d.peak for d in done), "MiB", len(done))}


def driven(
    settings: Settings, items: list[Item], jobs: int, report: Callable[[str], None]
) -> list[Driven]:
    """Drive in new processes, each of which first makes one drive of each arm that is not counted.

    Args:
        settings: settings of the drives.
        items: episodes and arms; those in buildings without a task are left out.
        jobs: number of processes.
        report: function that shows the progress.

    Returns:
        The drives in the order of the items.

    Raises:
        WorkersError: if a process dies.
    """
    done: list[Driven] = []
    with ProcessPoolExecutor(jobs, get_context("spawn"), _begin, (settings, os.getpid())) as pool:
        try:
            # Python's `map` cancels the drives that have not begun, if this is interrupted.
            results = pool.map(partial(_one, settings), items)
            for ended, result in enumerate(results):
                report(f"{ended + 1} of {len(items)} drives by {jobs} at a time")
                if result is not None:
                    done.append(result)
        except BrokenProcessPool as error:
            raise WorkersError("a process that drove has died") from error
    return done


def _begin(settings: Settings, parent: int) -> None:
    follow_parent(parent)
    for arm in settings.arms:
        drive(settings, 0, arm)


def _one(settings: Settings, item: Item) -> Driven | None:
    started = time.perf_counter()
    try:
        result = drive(settings, *item).result
    except NoTaskError:
        return None
    return Driven(float(result.time), time.perf_counter() - started, peak())


def peak() -> float:
    """Return the largest memory of this process so far [MiB]."""
    # getrusage only as a fallback, since on Linux it includes the peak of the parent process.
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8", errors="replace").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
