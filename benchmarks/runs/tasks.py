"""The tasks of a comparison: which building, start and goal belong to the number of an episode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.optimal.shortest_path import NoPathError, path_length, shortest_path
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from foresee.infra.workers import WorkersError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.polyline import arc_length
from sim.buildings import map_hash, map_hashes, sources, task_in
from sim.map_server import load_world
from sim.task import NoTaskError, Rules, Task, find_way, waypoints_along
from sim.task_file import GivenTask, TaskFile
from sim.world import sealed


def make_task(settings: Settings, index: int) -> Task:
    """Return the task (building, start, goal, route) of an episode, the same for all arms and cars.

    Raises:
        NoTaskError: if the building has no route of at least 10 m, or the given task no route; or
            if a drawn route is to be prescribed, but passes a place twice.
        TaskFileError: if the tasks are given, and their file is broken.
    """
    task = _task(*_episode_source(settings, index))
    if settings.route == "fixed" and settings.tasks is None and task.comes_back:
        raise NoTaskError(f"{task.world.name}: the route passes a place twice")
    return task


@lru_cache(maxsize=2)
def _task(place: str, seed: int, given: GivenTask | None) -> Task:
    return task_in(place, seed) if given is None else _given_task(place, seed, given)


def _given_task(place: str, seed: int, given: GivenTask) -> Task:
    """Return a task of a file.

    Its route is one that the car can drive forwards, else the shortest path: a car with a reverse
    gear may still reach the goal.
    """
    world = sealed(load_world(place))
    given.check_ends(world)
    way = find_way(world, given.start, given.goal, given.rules.goal_radius)
    if way is None:
        try:
            radius = CarLimits().body.half_width
            way = np.asarray(shortest_path(world, given.start[:2], given.goal, radius))
        except NoPathError as error:
            raise NoTaskError(str(error)) from None
    length = float(arc_length(way)[-1])
    return Task(world, given.start, given.goal, waypoints_along(way), length, seed, given.rules)


def limit_speed(settings: Settings, rules: Iterable[Rules]) -> Settings:
    """Return settings with the top speed lowered to the highest that any of some rules allows."""
    speeds = [r.top_speed or settings.v_max for r in rules]
    return replace(settings, v_max=min(settings.v_max, max(speeds)))


def read_rules(settings: Settings) -> list[Rules]:
    """Return the rules of the given tasks of a run, or those of all drawn tasks.

    Raises:
        TaskFileError: if the file of given tasks is broken.
    """
    if settings.tasks is None:
        return [Rules()]
    return [task.rules for task in TaskFile.read(Path(settings.tasks)).tasks]


def input_hashes(settings: Settings) -> dict[str, str]:
    """Return the hash of each map file, and of the file of given tasks, after checking them.

    Raises:
        UsageError: if `world` names no buildings, or not the maps of the tasks.
        MapError: if a map cannot be read.
        TaskFileError: if the file of tasks is broken, or a start or a goal is not free.
    """
    hashes = map_hashes(settings.world)
    if settings.tasks is not None:
        hashes[settings.tasks], tasks = _given_tasks(settings.tasks, settings.world)
        of_place = itemgetter(0)
        for place, group in groupby(sorted(tasks, key=of_place), of_place):
            world = sealed(load_world(place))
            for _, task in group:
                task.check_ends(world)
    return hashes


def refuse_edited_inputs(settings: Settings, index: int, hashes: Mapping[str, str]) -> None:
    """Refuse an episode whose map or given task is another than at the start of the run.

    Args:
        settings: settings of the run.
        index: number of the episode.
        hashes: hash of each file at the start of the run, see `input_hashes`.

    Raises:
        WorkersError: if a file has been edited since, or is another on this machine.
        NoTaskError: if the episode has no task.
    """
    place, _, _ = _episode_source(settings, index)
    present = dict[str, str]()
    if place in hashes:
        present[place] = map_hash(make_task(settings, index).world.grid)
    if settings.tasks is not None and settings.tasks in hashes:
        present[settings.tasks], _ = _given_tasks(settings.tasks, settings.world)
    for path, digest in present.items():
        if digest != hashes[path]:
            raise WorkersError(f"a worker has another file {path} than at the start of this run")


def _episode_source(settings: Settings, index: int) -> tuple[str, int, GivenTask | None]:
    """Return the family or map file of an episode, its seed, and its task if it is given."""
    if settings.tasks is None:
        places = sources(settings.world)
        return places[index % len(places)], settings.seed + index // len(places), None
    _, tasks = _given_tasks(settings.tasks, settings.world)
    place, given = tasks[index % len(tasks)]
    return place, settings.seed + index // len(tasks), given


def _given_tasks(path: str, world: tuple[str, ...]) -> tuple[str, list[tuple[str, GivenTask]]]:
    """Return the hash of a file of tasks, and its tasks, each with its map file.

    Raises:
        UsageError: if `world` does not name the maps of the tasks.
        TaskFileError: if the file is broken.
    """
    places = sources(world)
    if any(place in FAMILIES for place in places):
        raise UsageError("--tasks needs the maps of its tasks: give --world, without families")
    named: dict[str | None, list[str]] = {None: places}
    for place in places:
        named.setdefault(Path(place).stem, []).append(place)
    file = TaskFile.read(Path(path))
    for task in file.tasks:
        count = len(named.get(task.map, ()))
        if count != 1:
            what = f"--world has {'no' if count == 0 else 'more than one'} map {task.map}"
            if task.map is None:
                what = f"a task must name its map, since --world has {count}"
            raise UsageError(f"--tasks {path}: {what}")
    return file.digest, [(named[task.map][0], task) for task in file.tasks]


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
