"""The search for the time-optimal drive of a task, from several first guesses."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.optimal.first_guesses import candidate_paths, timed
from benchmarks.optimal.minimum_time import AROUND, MinimumTime, TimeOptimalDrive
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import TICK
from sim.task import Task

FINE = 0.05
"""Approximate tick with which the best drive, found with ticks of `TICK`, is refined [s]."""
GENTLE = 0.4
"""Share of the car's limits that guesses use if those at the limits lead to no valid drive."""
ITERATIONS = 150
"""Largest number of solver iterations from a guess; twice as many from a gentle one."""


def time_optimal(
    task: Task, car: CarLimits, goal_radius: float
) -> tuple[TimeOptimalDrive | None, int]:
    """Search for the time-optimal drive of a task.

    Args:
        task: building, start and goal.
        car: limits and body of the car.
        goal_radius: distance from the goal at which a drive ends [m].

    Returns:
        The drive, or None if none was found, and the number of first guesses.
    """
    known = list(candidate_paths(task, car, goal_radius))
    if not known:
        return None, 0
    points = np.vstack([task.start[:2], task.goal, *(path for _, path in known)])
    box = np.stack([points.min(axis=0) - AROUND, points.max(axis=0) + AROUND])
    problem, tried = MinimumTime(task, car, goal_radius, box), 0
    for share, iterations in ((1.0, ITERATIONS), (GENTLE, 2 * ITERATIONS)):
        guesses = [timed(name, path, task.start[2], car, TICK, share) for name, path in known]
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
