"""The tasks of a comparison: which building, start and goal belong to the number of an episode."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.optimal.shortest_path import NoPathError, path_length, shortest_path
from benchmarks.runs.car import limits_for
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from foresee.infra.workers import WorkersError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.polyline import arc_length
from sim.buildings import building, map_hash, map_hashes, sources, task_in_world
from sim.task import NoTaskError, Rules, Task, find_way, waypoints_along
from sim.task_file import GivenTask, TaskFile
from sim.world import World


def make_task(settings: Settings, index: int) -> Task:
    """Return the task (building, start, goal, route) of an episode, the same for all arms.

    It depends on the car's body and turning radius, not on its speeds and accelerations.

    Raises:
        NoTaskError: if the building has no route of at least 10 m, or the given task no route; or
            if a drawn route is to be prescribed, but passes a place twice.
        TaskFileError: if the tasks are given, and their file is broken, or a start or a goal is not
            free.
    """
    return _prescribable(_task(_episode_source(settings, index)), settings)


def make_task_in(world: World, settings: Settings) -> Task:
    """Return the task between --start and --goal in a building, or a drawn one without these.

    Args:
        world: the building, whatever the settings say.
        settings: settings of the comparison, of which the seed is that of the task.

    Raises:
        NoTaskError: if the building has no route of at least 10 m, or the given task no route; or
            if a drawn route is to be prescribed, but passes a place twice.
        TaskFileError: if the given start or goal is not free.
    """
    given, car = _start_to_goal(settings), limits_for(settings)
    if given is None:
        return _prescribable(task_in_world(world, settings.seed, car), settings)
    return _given_task(world, settings.seed, given, car)


def _prescribable(task: Task, settings: Settings) -> Task:
    """Return a task, unless its drawn route is to be prescribed, but passes a place twice."""
    if settings.route == "fixed" and settings.draws_tasks and task.comes_back:
        raise NoTaskError(f"{task.world.name}: the route passes a place twice")
    return task


class _Source(NamedTuple):
    """What an episode's task is made from.

    Attributes:
        place: family or map file of its building.
        building: seed of a generated building.
        seed: seed of the task.
        given: the task, if it is not drawn.
        car: limits and body of the car.
    """

    place: str
    building: int
    seed: int
    given: GivenTask | None
    car: CarLimits


@lru_cache(maxsize=2)
def _task(source: _Source) -> Task:
    world = building(source.place, source.building)
    if source.given is None:
        return task_in_world(world, source.seed, source.car)
    return _given_task(world, source.seed, source.given, source.car)


def _given_task(world: World, seed: int, given: GivenTask, car: CarLimits) -> Task:
    """Return a given task in its building.

    Its route is one that the car can drive forwards, else the shortest path: a car with a reverse
    gear may still reach the goal.
    """
    given.check_ends(world, car.body)
    way = find_way(world, given.start, given.goal, given.rules.goal_radius, car)
    if way is None:
        try:
            width = car.body.half_width
            way = np.asarray(shortest_path(world, given.start[:2], given.goal, width))
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
        UsageError: if `world` names no buildings, files of the same name, not the maps of the
            tasks, or several buildings for a single given task.
        MapError: if a map cannot be read.
        TaskFileError: if the file of tasks is broken, or a start or a goal is not free.
    """
    hashes = map_hashes(settings.world)
    named = dict[str, str]()
    for path in hashes:
        other = named.setdefault(Path(path).stem, path)
        if other != path and settings.draws_tasks:
            raise UsageError(
                f"--world: {other} and {path} have the same name, by which results tell buildings "
                "apart: rename one"
            )
    if settings.tasks is not None:
        hashes[settings.tasks] = TaskFile.read(Path(settings.tasks)).digest
    if not settings.draws_tasks:
        of_place = itemgetter(0)
        for place, group in groupby(sorted(_given_tasks(settings), key=of_place), of_place):
            world = building(place, settings.seed)
            for _, task in group:
                task.check_ends(world, limits_for(settings).body)
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
    place = _episode_source(settings, index).place
    present = dict[str, str]()
    if place in hashes:
        present[place] = map_hash(make_task(settings, index).world.grid)
    if settings.tasks is not None and settings.tasks in hashes:
        present[settings.tasks] = TaskFile.read(Path(settings.tasks)).digest
    for path, digest in present.items():
        if digest != hashes[path]:
            raise WorkersError(f"a worker has another file {path} than at the start of this run")


def _episode_source(settings: Settings, index: int) -> _Source:
    """Return what the task of an episode is made from."""
    car = limits_for(settings)
    if settings.draws_tasks:
        places = sources(settings.world)
        seed = settings.seed + index // len(places)
        return _Source(places[index % len(places)], seed, seed, None, car)
    tasks = _given_tasks(settings)
    place, given = tasks[index % len(tasks)]
    # Later drives of a task are in the same building, with other noise.
    return _Source(place, settings.seed, settings.seed + index // len(tasks), given, car)


def _start_to_goal(settings: Settings) -> GivenTask | None:
    """Return the task between --start and --goal; None without these."""
    if settings.start is None or settings.goal is None:
        return None
    return GivenTask(None, settings.start, settings.goal, Rules())


def _given_tasks(settings: Settings) -> list[tuple[str, GivenTask]]:
    """Return the given tasks, each with its family or map file.

    Raises:
        UsageError: if `world` does not name the maps of the tasks, or several buildings for a
            single task.
        TaskFileError: if the file of tasks is broken, or a task starts at its goal.
    """
    places, given = sources(settings.world), _start_to_goal(settings)
    if given is None:
        return _tasks_of_file(str(settings.tasks), places)
    if len(places) > 1:
        raise UsageError(
            f"--start and --goal are a task in one building, --world names {len(places)}"
        )
    return [(places[0], given)]


def _tasks_of_file(path: str, places: list[str]) -> list[tuple[str, GivenTask]]:
    """Return the tasks of a file, each with its map file."""
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
    return [(named[task.map][0], task) for task in file.tasks]


@lru_cache(maxsize=2)
def shortest_length(task: Task, half_width: float) -> float | None:
    """Return the length of the shortest path of a task with the whole map known [m].

    Args:
        task: start, goal and map.
        half_width: half the width of the car [m].

    Returns:
        None if no path was found: `benchmarks.optimal.shortest_path` may miss a gap that is hardly
        wider than the car.
    """
    try:
        return path_length(shortest_path(task.world, task.start[:2], task.goal, half_width))
    except NoPathError:
        return None


def task_facts(task: Task) -> dict[str, Any]:
    """Return the facts of a task for the results: name of the building, seed, start and goal."""
    start, goal = ([float(v) for v in place] for place in (task.start, task.goal))
    return {"world": task.world.name, "seed": task.seed, "start": start, "goal": goal}
