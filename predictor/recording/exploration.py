"""Explorations of generated buildings by a point that moves, and the frontiers on their way.

The point follows the planner's route without a car's dynamics, which is a hundred times faster than
a drive. The true map of the building tells where each frontier leads.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from foresee.frontiers import FrontierValues
from foresee.infra.resumable import ResumableFolder
from foresee.infra.workers import finished
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import GOAL_RADIUS
from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import Grid, GridFrame, OccupancyGrid, world_hash
from foresee.mapping.polyline import arc_length
from planner.guide.frontiers import FrontierMap, observed
from planner.guide.route import costs_from, find_route
from planner.guide.subgoals import with_frontiers
from planner.risk.cost_map import CostMap
from predictor.data.frontier_samples import (
    COLUMNS,
    GOALS,
    pictures_of,
    way_back,
    write_frontiers,
)
from predictor.networks.frontier_net import FARTHEST
from predictor.recording.settings import FrontiersConfig
from sim import Lidar
from sim.buildings import task_in_world
from sim.families import generate
from sim.task import NoTaskError, Task
from sim.world import World

SPLITS = {"train": 1_400_000, "validation": 530_000}
"""First seed of each split. Published measurements and the training of `compact` use others."""
WINDOW = 5.0
"""Side of the square in which the LIDAR is used [m]."""
STEP = 0.4
"""Distance from one scan to the next [m]."""
REPLAN, RECORD = 2, 8
"""Number of scans from one route to the next, and from one recorded map to the next."""
LONGEST = 8.0
"""Distance after which an exploration ends, as a multiple of the task's way."""
POLICIES = 3
"""Number of ways in which explorations choose their route: without a prediction, by the true map,
and by the true map with noise. Together they visit the places that a better or worse predictor of
frontiers leads to."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The true map of a building, on the cells of the route search.

    Attributes:
        frame: frame of the observed map that it belongs to.
        open: cells in which a body fits, (rows, columns).
    """

    frame: GridFrame
    open: NDArray[np.bool_]

    @classmethod
    def on(cls, world: World, frame: GridFrame) -> Truth:
        """Return the truth for an observed map of a frame."""
        whole = OccupancyGrid.from_grid(world.grid.crop(frame), WINDOW)
        return cls(frame, observed(CostMap.build(whole, None, CarLimits().body.half_width)))

    def ways(
        self, found: FrontierMap, goal: tuple[int, int]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the columns `leads` and `way` (see `COLUMNS`) of each frontier, (n,) each.

        Args:
            found: frontiers of the observed map.
            goal: row and column of the goal.
        """
        beyond = self._beyond(found)
        leads, way = np.zeros((2, len(found.frontiers)))
        if np.isfinite(beyond[goal]):
            to_goal = costs_from(beyond, found.frame.resolution, goal)
            for number, cells in enumerate(_cells(found, beyond)):
                least = float(to_goal[cells[:, 0], cells[:, 1]].min(initial=math.inf))
                if least < math.inf:
                    leads[number], way[number] = 1.0, least
        return leads, way

    def depths(self, found: FrontierMap) -> NDArray[np.float64]:
        """Return the column `beyond` (see `COLUMNS`) of each frontier, (n,)."""
        beyond = self._beyond(found)
        depths = np.zeros(len(found.frontiers))
        for number, cells in enumerate(_cells(found, beyond)):
            if len(cells):
                row, col = (int(n) for n in cells[len(cells) // 2])
                ways = costs_from(beyond, found.frame.resolution, (row, col))
                depths[number] = ways[np.isfinite(ways)].max()
        return depths

    def _beyond(self, found: FrontierMap) -> NDArray[np.float32]:
        """Return the costs of the cells that ways beyond a frontier may use, (rows, columns)."""
        # They may not return to the reached space.
        return np.where(self.open & ~found.reached, np.float32(1.0), np.float32(np.inf))


def _cells(found: FrontierMap, beyond: NDArray[np.float32]) -> Iterator[NDArray[np.intp]]:
    """Yield rows and columns of the cells of each frontier that are truly open, (k, 2)."""
    for number, part in enumerate(ndimage.find_objects(found.labels), start=1):
        inside = (found.labels[part] == number) & np.isfinite(beyond[part])
        yield np.argwhere(inside) + np.array([part[0].start, part[1].start])


class Informed:
    """A predictor of frontiers that knows the true map, with noise.

    Args:
        truth: true map.
        found: the frontiers that it will be asked about.
        noise: weight in [0, 1] of a random number in each probability.
        rng: generator of the noise.
    """

    def __init__(
        self, truth: Truth, found: FrontierMap, noise: float, rng: np.random.Generator
    ) -> None:
        self.truth, self.found, self.noise, self.rng = truth, found, noise, rng

    def values(
        self, known: Grid, goal: tuple[float, float], frontiers: Sequence[Frontier]
    ) -> FrontierValues:
        """Return where the frontiers truly lead."""
        leads, way = self.truth.ways(self.found, self.found.goal)
        noisy = (1.0 - self.noise) * leads + self.noise * self.rng.random(len(leads))
        straight = [float(np.hypot(*(f.middle - goal))) for f in frontiers]
        return FrontierValues(
            noisy,
            np.where(leads > 0, way, straight),
            way_back(self.truth.depths(self.found)),
        )


def explore(task: Task, policy: int, rng: np.random.Generator) -> list[tuple[NDArray[Any], ...]]:
    """Explore a building, and return the samples on the way.

    Args:
        task: building, start and goal.
        policy: 0: without prediction; 1: with the true map; 2: with the true map and noise.
        rng: generator of noise and of further goals.

    Returns:
        Picture, numbers and size of each frontier, see `predictor.data.frontier_samples`.
    """
    known, lidar, width = task.blank(WINDOW), Lidar(), CarLimits().body.half_width
    known.cover(known.frame.square(*task.goal, WINDOW))
    pose = np.array(task.start)
    known.mark_free(pose, CarLimits().body, 0.5)
    truth: Truth | None = None
    samples: list[tuple[NDArray[Any], ...]] = []
    route = np.empty((0, 2))
    for tick in range(math.ceil(LONGEST * task.path_length / STEP)):
        known.integrate(lidar.scan(task.world, pose), pose)
        at = (float(pose[0]), float(pose[1]))
        if math.dist(at, task.goal) < GOAL_RADIUS:
            break
        if tick % REPLAN == 0:
            cost = CostMap.build(known, None, width)
            found = FrontierMap.of(cost, at, task.goal)
            if found is not None and found.frontiers and (policy or tick % RECORD == 0):
                if truth is None or truth.frame != known.frame:
                    truth = Truth.on(task.world, known.frame)
                if tick % RECORD == 0:
                    samples += _samples(known, found, truth, task.goal, rng)
                if policy:
                    informed = Informed(truth, found, 0.5 * (policy - 1), rng)
                    cost = with_frontiers(cost, known, at, task.goal, informed)
            fresh = find_route(cost, at, task.goal)
            if fresh is None:
                break
            route = fresh
        pose, route = _advanced(route)
    return samples


def _samples(
    known: OccupancyGrid,
    found: FrontierMap,
    truth: Truth,
    goal: tuple[float, float],
    rng: np.random.Generator,
) -> list[tuple[NDArray[Any], ...]]:
    """Return the samples of a map: picture, numbers and size of each frontier."""
    pictures, middles = pictures_of(known.whole(), found.frontiers)
    hidden = np.argwhere(truth.open & ~found.reached & np.isfinite(found.costs))
    goals = [(found.goal, np.array(goal))]
    while len(goals) < GOALS and len(hidden):
        cell = tuple(int(n) for n in hidden[rng.integers(len(hidden))])
        goals.append(((cell[0], cell[1]), np.array(found.frame.centre(*cell))))
    goals += goals[:1] * (GOALS - len(goals))
    numbers = np.zeros((len(found.frontiers), GOALS, len(COLUMNS)), dtype=np.float32)
    cells = [found.frame.cell(*map(float, f.middle)) for f in found.frontiers]
    numbers[:, :, COLUMNS.index("beyond")] = truth.depths(found)[:, None]
    for number, (cell, place) in enumerate(goals):
        to_go = costs_from(found.costs, found.frame.resolution, cell)
        numbers[:, number, :2] = place - middles
        numbers[:, number, 2] = np.minimum([to_go[at] for at in cells], FARTHEST)
        numbers[:, number, 3:5] = np.transpose(truth.ways(found, cell))
    sizes = [np.array(len(frontier.points)) for frontier in found.frontiers]
    return list(zip(pictures, numbers, sizes, strict=True))


def _advanced(route: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pose after a step along a route (n, 2), and the rest of the route."""
    along = arc_length(route)
    here = min(STEP, float(along[-1]))
    place = np.array([np.interp(here, along, route[:, axis]) for axis in (0, 1)])
    rest = np.vstack([place, route[along > here]])
    ahead = (rest[1] if len(rest) > 1 else place) - route[0]
    return np.array([*place, math.atan2(ahead[1], ahead[0])]), rest


def record(config: FrontiersConfig, item: tuple[str, int]) -> tuple[int, str]:
    """Make and write the samples of one building.

    Args:
        config: settings of the samples.
        item: split, and number of the building in it.

    Returns:
        The number of samples; and why there is none, or an empty string.
    """
    split, number = item
    seed = SPLITS[split] + number
    family = config.families[number % len(config.families)]
    world = generate(family, seed)
    samples, why = [], ""
    try:
        task = task_in_world(world, seed)
        # Independent of the family, whose position in the list the number decides.
        policy = number // len(config.families) % POLICIES
        samples = explore(task, policy, np.random.default_rng([seed, 3]))
    except NoTaskError as error:
        why = str(error)
    about = {"family": family, "seed": seed, "world": world_hash(world.grid.cells)}
    pictures, numbers, sizes = zip(*samples, strict=True) if samples else ((), (), ())
    write_frontiers(path_of(config, item), pictures, numbers, [float(n) for n in sizes], about)
    return len(samples), why


def path_of(config: FrontiersConfig, item: tuple[str, int]) -> Path:
    """Return the path of the file with a building's samples."""
    return config.data / item[0] / f"{item[1]:06d}.npz"


def make(config: FrontiersConfig, jobs: int) -> None:
    """Make all missing samples, with a progress bar.

    Args:
        config: settings of the samples.
        jobs: number of worker processes.

    Raises:
        UsageError: if the folder holds samples that were made with other settings.
    """
    from tqdm import tqdm

    told = {"families": list(config.families), "seeds": SPLITS}
    with ResumableFolder(config.data, told, exclusive=True):
        for split in SPLITS:
            ResumableFolder(config.data / split)
        items = [(split, n) for split in SPLITS for n in range(getattr(config, split))]
        todo = [item for item in items if not path_of(config, item).exists()]
        count, unexplored = 0, set[str]()
        with tqdm(total=len(items), initial=len(items) - len(todo), unit="building") as bar:
            for _, (samples, why) in finished(partial(record, config), todo, jobs):
                count += samples
                if why and why not in unexplored:
                    unexplored.add(why)
                    bar.write(why, file=sys.stderr)
                bar.set_postfix_str(f"{count} samples")
                bar.update()
