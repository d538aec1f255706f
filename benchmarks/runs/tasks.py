"""The tasks of a comparison: which building, start and goal belong to the number of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from benchmarks.optimal.shortest_path import NoPathError, path_length, shortest_path
from benchmarks.runs.settings import Settings
from foresee.infra.workers import WorkersError
from foresee.mapping.car_limits import CarLimits
from sim.buildings import map_hash, sources, task_in
from sim.task import Task


def make_task(settings: Settings, index: int) -> Task:
    """Return the task (building, start, goal, route) of an episode, the same for all arms and cars.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    return _task_in(*_episode_source(settings, index))


_task_in = lru_cache(maxsize=2)(task_in)


def refuse_edited_map(settings: Settings, index: int, maps: Mapping[str, str]) -> None:
    """Refuse an episode in a map that is another than at the start of the run.

    Args:
        settings: settings of the run.
        index: number of the episode.
        maps: hash of each map file at the start of the run, see `sim.buildings.map_hashes`.

    Raises:
        WorkersError: if the map has been edited since, or is another on this machine.
        NoTaskError: if the building has no route of at least 10 m.
    """
    place, _ = _episode_source(settings, index)
    if place in maps and map_hash(make_task(settings, index).world.grid) != maps[place]:
        raise WorkersError(f"a worker has another map {place} than at the start of this run")


def _episode_source(settings: Settings, index: int) -> tuple[str, int]:
    """Return the family or map file of an episode, and the seed of its task."""
    places = sources(settings.world)
    return places[index % len(places)], settings.seed + index // len(places)


@lru_cache(maxsize=2)
def shortest_length(task: Task) -> float | None:
    """Return the length of the shortest path of a task with the whole map known [m].

    Returns:
        None if no path was found: `benchmarks.optimal.shortest_path` may miss a gap that is hardly
        wider than the car.
    """
    radius = CarLimits().body.half_width
    try:
        return path_length(shortest_path(task.world, task.start[:2], task.goal, radius))
    except NoPathError:
        return None


def task_facts(task: Task) -> dict[str, Any]:
    """Return the facts of a task for the results: name of the building, seed, start and goal."""
    start, goal = ([float(v) for v in place] for place in (task.start, task.goal))
    return {"world": task.world.name, "seed": task.seed, "start": start, "goal": goal}
