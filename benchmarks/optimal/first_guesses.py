"""First guesses of a minimum-time drive: several paths to the goal, each with a speed profile."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from benchmarks.optimal.minimum_time import Guess
from benchmarks.optimal.shortest_path import NoPathError, shortest_path
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.polyline import arc_length, points_at
from sim.arc_search import search_arcs
from sim.car import along_arc, wrap
from sim.task import Task

TAUT = ((0.35, 0.5), (0.8, 1.0))
"""Shortest paths to try: radius of the disc [m], and standard deviation of their smoothing [m]."""
ARCS = ((1.1, 0.4), (2.0, 0.4), (1.1, 1.5), (3.75, 0.4))
"""Paths of arcs to try: radius divided by the car's turning radius, and clearance that they prefer
[m]."""
ROUNDING = 0.2
"""Standard deviation of the smoothing of paths of arcs [m]."""
AWAY = math.pi / 3
"""Angle between the start's heading and the shortest path above which paths that first turn to the
left or to the right are tried, too [rad]."""
TURN, JOIN = 1.2, 5.0
"""Radius of that turn [m], and distance along the shortest path at which it joins the path [m]."""
CLEARANCE = 0.03
"""Free space that paths of arcs keep around the body [m]."""
STEP = 0.05
"""Distance between two points of a path [m]."""
DETOUR = 1.8
"""Longest path of arcs to follow, divided by the length of the task's route."""


def candidate_paths(
    task: Task, car: CarLimits, goal_radius: float
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the name and the points (n, 2) [m] of paths to near the goal.

    First come the shortest paths of discs, which ignore the heading at the start, and the first of
    them with a turn to the left or to the right before it. The others are the cheapest paths of
    arcs, which respect the heading and the turning radius. Some may not be drivable.

    Args:
        task: building, start and goal.
        car: body and turning radius of the car.
        goal_radius: distance from the goal at which a drive ends [m].
    """
    for radius, sigma in TAUT:
        try:
            path = shortest_path(task.world, task.start[:2], task.goal, radius)
        except NoPathError:
            continue
        even = _evenly(path, goal_radius)
        yield f"taut {radius:g} m", _smooth(even, sigma)
        away = wrap(math.atan2(*(even[4] - even[0])[::-1]) - task.start[2])
        if radius == TAUT[0][0] and abs(away) > AWAY:
            for name, side in (("left", 1.0), ("right", -1.0)):
                yield f"{name} turn", _smooth(_turned(even, task.start, side), ROUNDING)
    for times, comfort in ARCS:
        bent = _arcs(task, car, times * car.turning_radius, comfort, goal_radius)
        if bent is not None:
            yield f"arcs {times * car.turning_radius:g}, {comfort:g} m", _smooth(bent, ROUNDING)


def timed(
    name: str,
    path: NDArray[np.float64],
    yaw: float,
    car: CarLimits,
    tick: float,
    share: float = 1.0,
) -> Guess:
    """Return a drive along a path, as fast as the car's limits allow.

    Args:
        name: name of the guess.
        path: points of the path, (n, 2), `STEP` apart [m].
        yaw: heading at the start [rad]; the headings along the path are the equivalent angles
            nearest to it.
        car: limits of the car.
        tick: longest duration of a tick [s].
        share: share of the top speed and of the lateral acceleration that is used.
    """
    along = arc_length(path)
    spacing = np.hypot(*np.diff(path, axis=0).T)
    slope = np.gradient(path, along, axis=0)
    headings = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    headings += 2.0 * math.pi * round((yaw - headings[0]) / (2.0 * math.pi))
    curvature = gaussian_filter1d(np.gradient(headings, along), 2.0)
    curvature = np.clip(curvature, -car.max_curvature, car.max_curvature)
    bend = np.maximum(np.abs(curvature), 1e-3)
    speed = np.minimum(share * car.v_max, np.sqrt(share * car.lateral_acceleration / bend))
    speed[0] = 0.0
    for i, step in enumerate(spacing):
        speed[i + 1] = min(speed[i + 1], math.sqrt(speed[i] ** 2 + 2 * car.acceleration * step))
    for i, step in reversed(list(enumerate(spacing))):
        speed[i] = min(speed[i], math.sqrt(speed[i + 1] ** 2 + 2 * car.braking * step))
    times = np.concatenate([[0.0], np.cumsum(2.0 * spacing / (speed[1:] + speed[:-1]))])
    ticks = max(2, math.ceil(times[-1] / tick))
    at = np.linspace(0.0, times[-1], ticks + 1)
    columns = (path[:, 0], path[:, 1], headings, speed)
    states = np.stack([np.interp(at, times, column) for column in columns], axis=1)
    dt = float(times[-1]) / ticks
    held = np.interp(0.5 * (at[1:] + at[:-1]), times, curvature)
    return Guess(name, dt, states, np.stack([np.diff(states[:, 3]) / dt, held], axis=1))


def _turned(
    path: NDArray[np.float64], start: tuple[float, float, float], side: float
) -> NDArray[np.float64]:
    """Return a path that starts with an arc, up to where it points at the path's point at `JOIN`.

    Args:
        path: points of the path, (n, 2) [m].
        start: x, y, yaw [m, m, rad].
        side: 1 for a turn to the left, -1 to the right.
    """
    join = min(len(path) - 1, round(JOIN / STEP))
    points = []
    for along in np.arange(0.0, 2.0 * math.pi * TURN, STEP):
        x, y, yaw = along_arc(*start, side / TURN, along)
        points.append((x, y))
        if abs(wrap(math.atan2(path[join, 1] - y, path[join, 0] - x) - yaw)) < STEP / TURN:
            break
    return _evenly(np.vstack([points, path[join:]]), 0.0)


def _arcs(
    task: Task, car: CarLimits, radius: float, comfort: float, goal_radius: float
) -> NDArray[np.float64] | None:
    """Return the cheapest path of arcs to near the goal, (n, 2) [m]; None if there is none."""
    poses, parents, _, _ = search_arcs(
        task.world, task.start, car.body, radius, CLEARANCE, comfort, DETOUR * task.path_length
    )
    # Poses are in the order of their cost.
    near = np.flatnonzero(np.hypot(*(poses[:, :2] - task.goal).T) <= 1.2 * goal_radius)
    if len(near) == 0:
        return None
    node, path = int(near[0]), []
    while parents[node] >= 0:
        x, y, yaw = poses[parents[node]]
        turn, chord = wrap(poses[node, 2] - yaw), math.dist(poses[node, :2], (x, y))
        length = chord if abs(turn) < 1e-6 else 0.5 * chord * turn / math.sin(0.5 * turn)
        parts = [along_arc(x, y, yaw, turn / length, length * i / 4)[:2] for i in range(1, 5)]
        path += parts[::-1]
        node = int(parents[node])
    return _evenly(np.array([task.start[:2], *path[::-1]]), 0.0)


def _evenly(path: NDArray[np.float64], left: float) -> NDArray[np.float64]:
    """Return points `STEP` apart along a path, up to the distance `left` before its end [m]."""
    end = max(arc_length(path)[-1] - left, 4 * STEP)
    return points_at(path, np.linspace(0.0, end, max(4, round(end / STEP)) + 1))


def _smooth(path: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Smooth a path by a Gaussian of standard deviation `sigma` [m]; its ends do not move."""
    reach = min(len(path) - 1, math.ceil(4.0 * sigma / STEP))
    longer = np.pad(path, ((reach, reach), (0, 0)), "reflect", reflect_type="odd")
    smoothed = gaussian_filter1d(longer, sigma / STEP, axis=0)
    return np.asarray(smoothed[reach : reach + len(path)])
