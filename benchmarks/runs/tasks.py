"""The tasks of a comparison: which building, start and goal belong to the number of an episode."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks.optimal.shortest_way import NoWayError, shortest_way, way_length
from benchmarks.runs.settings import Settings
from predictor.infra.command_line import UsageError
from predictor.mapping.car_limits import CarLimits
from predictor.mapping.family_names import FAMILIES
from sim.families import generate
from sim.map_server import load_world
from sim.task import NoTaskError, Task, sample_task
from sim.world import World, sealed


def sources(names: tuple[str, ...]) -> list[str]:
    """Return the families and map files that `--world` names; a folder stands for the maps in it.

    Raises:
        UsageError: if a name is neither a family, nor a map file, nor a folder with map files; if
            a family or file is named twice.
    """
    found: list[str] = []
    for name in names:
        path = Path(name)
        if name in FAMILIES:
            found.append(name)
        elif path.is_dir():
            maps = sorted(str(p) for p in path.iterdir() if p.suffix in (".yaml", ".yml"))
            if not maps:
                raise UsageError(f"--world: no .yaml map in the folder {name}")
            found += maps
        elif path.suffix in (".yaml", ".yml"):
            if not path.is_file():
                raise UsageError(f"--world: no such file: {name}")
            found.append(name)
        else:
            raise UsageError(
                f"--world: {name!r} is no family ({', '.join(FAMILIES)}), no .yaml map, no folder"
            )
    for name in found:
        if found.count(name) > 1:
            raise UsageError(f"--world: {name} is given twice: its tasks would be driven twice")
    return found


def check_maps(names: tuple[str, ...]) -> None:
    """Check that each map file that `--world` names can be loaded.

    Raises:
        UsageError: if a name is neither a family, nor a map file, nor a folder with map files.
        MapError: if a map cannot be read.
    """
    for place in sources(names):
        if place not in FAMILIES:
            load_world(place)


@lru_cache(maxsize=2)
def task_of(settings: Settings, index: int) -> Task:
    """Return the task (building, start, goal, route) of an episode, the same for all arms and cars.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    places = sources(settings.world)
    place, seed = places[index % len(places)], settings.seed + index // len(places)
    return task_in(place, seed)


def task_in(place: str, seed: int) -> Task:
    """Return a task in one of `sources`.

    Args:
        place: family of generated buildings, or path of a map file.
        seed: seed of start and goal, and of a generated building.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    world = generate(place, seed) if place in FAMILIES else sealed(load_world(place))
    return task_in_world(world, seed)


def task_in_world(world: World, seed: int) -> Task:
    """Return a task in a building, of at least 20 m, or of at least 10 m if there is none.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    try:
        return sample_task(world, seed)
    except NoTaskError:
        return sample_task(world, seed, min_length=10.0)


@lru_cache(maxsize=2)
def shortest_length(task: Task) -> float | None:
    """Return the length of the shortest path of a task with the whole map known [m].

    Returns:
        None if no path was found: `benchmarks.optimal.shortest_way` may miss a gap that is hardly
        wider than the car.
    """
    radius = CarLimits().body.half_width
    try:
        return way_length(shortest_way(task.world, task.start[:2], task.goal, radius))
    except NoWayError:
        return None


def facts_of(task: Task) -> dict[str, Any]:
    """Return the facts of a task for the results: name of the building, seed, start and goal."""
    start, goal = ([float(v) for v in place] for place in (task.start, task.goal))
    return {"world": task.world.name, "seed": task.seed, "start": start, "goal": goal}
