"""The fastest drives for the tasks of a comparison, with the whole map known."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from benchmarks.optimal.first_guesses import timed, ways
from benchmarks.optimal.minimum_time import AROUND, Drive, MinimumTime
from benchmarks.optimal.shortest_way import time_bound
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import facts_of, shortest_length, task_of
from foresee.infra.environment import commit
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import TICK
from sim.episode import EpisodeConfig
from sim.task import NoTaskError, Task

FINE = 0.05
"""Approximate tick with which the best drive, found with ticks of `TICK`, is refined [s]."""
GENTLE = 0.4
"""Share of the car's limits that guesses use if those at the limits lead to no valid drive."""
ITERATIONS = 150
"""Largest number of solver iterations from a guess; twice as many from a gentle one."""


def quickest(task: Task, car: CarLimits, goal_radius: float) -> tuple[Drive | None, int]:
    """Search for the fastest drive of a task.

    Args:
        task: building, start and goal.
        car: limits and body of the car.
        goal_radius: distance from the goal at which a drive ends [m].

    Returns:
        The drive, or None if none was found, and the number of first guesses.
    """
    known = list(ways(task, car, goal_radius))
    if not known:
        return None, 0
    points = np.vstack([task.start[:2], task.goal, *(way for _, way in known)])
    box = np.stack([points.min(axis=0) - AROUND, points.max(axis=0) + AROUND])
    problem, tried = MinimumTime(task, car, goal_radius, box), 0
    for share, iterations in ((1.0, ITERATIONS), (GENTLE, 2 * ITERATIONS)):
        guesses = [timed(name, way, task.start[2], car, TICK, share) for name, way in known]
        drives = [problem.solve(guess, iterations) for guess in guesses]
        tried += len(guesses)
        valid = [drive for drive in drives if drive.valid]
        if valid:
            best = min(valid, key=lambda drive: drive.time)
            # An even number, so that every other state can be kept.
            ticks = 2 * math.ceil(best.time / FINE / 2)
            fine = problem.solve(best.resampled(ticks), ITERATIONS, 1e-3)
            return fine if fine.valid and fine.time < best.time else best, tried
    return None, tried


def attempt(settings: Settings, index: int) -> dict[str, Any] | str:
    """Return an episode's entry in the results file, or one line that says why it has no task."""
    started = time.perf_counter()
    car = CarLimits(v_max=settings.v_max, braking=settings.braking)
    radius = EpisodeConfig().goal_radius
    try:
        task = task_of(settings, index)
    except NoTaskError as error:
        return str(error)
    length = shortest_length(task)
    # None if no path was found; a drive may still exist, through a gap hardly wider than the car.
    shortest = None if length is None else round(length, 4)
    drive, tried = quickest(task, car, radius)
    result = {
        "index": index,
        **facts_of(task),
        "t_opt": None,
        "t_bound": None if shortest is None else round(time_bound(shortest, car, radius), 4),
        "shortest": shortest,
        "guesses": tried,
        "commit": commit(),
    }
    if drive is not None:
        stride = 2 if len(drive.controls) % 2 == 0 else 1
        result |= {
            "t_opt": round(drive.time, 4),
            "guess": drive.name,
            "status": drive.status,
            "dt": round(drive.dt, 6),
            "every": stride,
            "states": [[round(float(v), 3) for v in state] for state in drive.states[::stride]],
        }
    return result | {"wall": round(time.perf_counter() - started, 2)}
