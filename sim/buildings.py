"""Buildings by name, as `--world` gives them: families of generated ones, map files, folders."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foresee.infra.command_line import UsageError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import Grid, world_hash
from foresee.mapping.resampling import resampled
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
    places: list[str] = []
    for name in names:
        path = Path(name)
        if name in FAMILIES:
            places.append(name)
        elif path.is_dir():
            maps = sorted(str(p) for p in path.iterdir() if p.suffix in (".yaml", ".yml"))
            if not maps:
                raise UsageError(f"--world: no .yaml map in the folder {name}")
            places += maps
        elif path.suffix in (".yaml", ".yml"):
            if not path.is_file():
                raise UsageError(f"--world: no such file: {name}")
            places.append(name)
        else:
            raise UsageError(
                f"--world: {name!r} is no family ({', '.join(FAMILIES)}), no .yaml map, no folder"
            )
    for name in places:
        if places.count(name) > 1:
            raise UsageError(f"--world: {name} is given twice: its tasks would be driven twice")
    return places


def check_maps(names: tuple[str, ...]) -> None:
    """Check that each map file that `--world` names can be loaded.

    Raises:
        UsageError: if a name is neither a family, nor a map file, nor a folder with map files.
        MapError: if a map cannot be read.
    """
    for place in sources(names):
        if place not in FAMILIES:
            load_world(place)


def map_hashes(names: tuple[str, ...]) -> dict[str, str]:
    """Return the hash of each map file that `--world` names, see `map_hash`.

    Raises:
        UsageError: if a name is neither a family, nor a map file, nor a folder with map files.
        MapError: if a map cannot be read.
    """
    places = [place for place in sources(names) if place not in FAMILIES]
    return {place: map_hash(sealed(load_world(place)).grid) for place in places}


def map_hash(grid: Grid) -> str:
    """Return a hash of the cells of a map, its resolution and its origin."""
    facts = [world_hash(grid.cells), *map(float, (grid.frame.resolution, *grid.frame.origin))]
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:32]


def building(place: str, seed: int) -> World:
    """Return one of `sources`.

    Args:
        place: family of generated buildings, or path of a map file.
        seed: seed of a generated building.
    """
    return generate(place, seed) if place in FAMILIES else sealed(load_world(place))


def at_sample_resolution(world: World) -> World:
    """Return a building with cells of 0.05 m, as trainings use it."""
    if abs(world.grid.frame.resolution / RESOLUTION - 1.0) < 1e-6:
        return world
    return sealed(World(world.name, resampled(world.grid, RESOLUTION)[0]))


def learned_forms(world: World) -> Iterator[NDArray[np.int8]]:
    """Yield the cells of a building as it is driven in, and as trainings use it."""
    yield world.grid.cells
    used = at_sample_resolution(world)
    if used is not world:
        yield used.grid.cells


def task_in(place: str, seed: int) -> Task:
    """Return a task in one of `sources`.

    Args:
        place: family of generated buildings, or path of a map file.
        seed: seed of start and goal, and of a generated building.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    return task_in_world(building(place, seed), seed)


def task_in_world(world: World, seed: int, car: CarLimits | None = None) -> Task:
    """Return a task in a building, of at least 20 m, or of at least 10 m if there is none.

    Args:
        world: the building.
        seed: seed of start and goal.
        car: the car's body and turning radius; None: the defaults.

    Raises:
        NoTaskError: if the building has no route of at least 10 m.
    """
    try:
        return sample_task(world, seed, car)
    except NoTaskError:
        return sample_task(world, seed, car, min_length=10.0)
