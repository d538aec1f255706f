"""Explorations of generated buildings by walks, and the frontiers on their way.

The true map of the building tells where each frontier leads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from foresee.frontiers import FrontierValues
from foresee.infra.resumable import ResumableFolder
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import Grid, GridFrame, OccupancyGrid, world_hash
from planner.guide.frontiers import FrontierMap, observed
from planner.guide.route import costs_from, find_route
from planner.guide.subgoals import with_frontiers
from planner.risk.cost_map import CostMap
from predictor.data.frontier_samples import (
    COLUMNS,
    GOALS,
    frontier_pictures,
    way_back,
    write_frontiers,
)
from predictor.networks.frontier_net import FARTHEST
from predictor.recording.sample_set import EXPLORATIONS, Item, make_missing, sample_path
from predictor.recording.settings import FrontiersConfig
from predictor.recording.walk import WINDOW, Place, walk
from sim.buildings import task_in_world
from sim.families import generate
from sim.task import NoTaskError, Task
from sim.world import World

RECORD = 8
"""Number of scans from one recorded map to the next."""
LONGEST = 8.0
"""Distance after which an exploration ends, as a multiple of the task's route."""
POLICIES = 3
"""Number of policies by which explorations choose their route: without a prediction, by the true
map, and by the true map with noise. Together they visit the places that a better or worse predictor
of frontiers leads to."""


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
        self, frontier_map: FrontierMap, goal: tuple[int, int]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the columns `leads` and `way` (see `COLUMNS`) of each frontier, (n,) each.

        Args:
            frontier_map: frontiers of the observed map.
            goal: row and column of the goal.
        """
        beyond = self._beyond(frontier_map)
        leads, lengths = np.zeros((2, len(frontier_map.frontiers)))
        if np.isfinite(beyond[goal]):
            to_goal = costs_from(beyond, frontier_map.frame.resolution, goal)
            for number, cells in enumerate(_cells(frontier_map, beyond)):
                least = float(to_goal[cells[:, 0], cells[:, 1]].min(initial=math.inf))
                if least < math.inf:
                    leads[number], lengths[number] = 1.0, least
        return leads, lengths

    def depths(self, frontier_map: FrontierMap) -> NDArray[np.float64]:
        """Return the column `beyond` (see `COLUMNS`) of each frontier, (n,)."""
        beyond = self._beyond(frontier_map)
        depths = np.zeros(len(frontier_map.frontiers))
        for number, cells in enumerate(_cells(frontier_map, beyond)):
            if len(cells):
                row, col = (int(n) for n in cells[len(cells) // 2])
                costs = costs_from(beyond, frontier_map.frame.resolution, (row, col))
                depths[number] = costs[np.isfinite(costs)].max()
        return depths

    def _beyond(self, frontier_map: FrontierMap) -> NDArray[np.float32]:
        """Return the costs of the cells that ways beyond a frontier may use, (rows, columns)."""
        # They may not return to the reached space.
        return np.where(self.open & ~frontier_map.reached, np.float32(1.0), np.float32(np.inf))


def _cells(frontier_map: FrontierMap, beyond: NDArray[np.float32]) -> Iterator[NDArray[np.intp]]:
    """Yield rows and columns of the cells of each frontier that are truly open, (k, 2)."""
    for number, part in enumerate(ndimage.find_objects(frontier_map.labels), start=1):
        inside = (frontier_map.labels[part] == number) & np.isfinite(beyond[part])
        yield np.argwhere(inside) + np.array([part[0].start, part[1].start])


class Informed:
    """A predictor of frontiers that knows the true map, with noise.

    Args:
        truth: true map.
        frontier_map: the frontiers that it will be asked about.
        noise: weight in [0, 1] of a random number in each probability.
        rng: generator of the noise.
    """

    def __init__(
        self, truth: Truth, frontier_map: FrontierMap, noise: float, rng: np.random.Generator
    ) -> None:
        self.truth, self.frontier_map, self.noise, self.rng = truth, frontier_map, noise, rng

    def values(
        self, known: Grid, goal: tuple[float, float], frontiers: Sequence[Frontier]
    ) -> FrontierValues:
        """Return where the frontiers truly lead."""
        leads, lengths = self.truth.ways(self.frontier_map, self.frontier_map.goal)
        noisy = (1.0 - self.noise) * leads + self.noise * self.rng.random(len(leads))
        straight = [float(np.hypot(*(f.middle - goal))) for f in frontiers]
        return FrontierValues(
            noisy,
            np.where(leads > 0, lengths, straight),
            way_back(self.truth.depths(self.frontier_map)),
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
    width = CarLimits().body.half_width
    truth: Truth | None = None
    samples: list[tuple[NDArray[Any], ...]] = []

    def route_to_goal(tick: int, known: OccupancyGrid, at: Place) -> NDArray[np.float64] | None:
        nonlocal truth
        cost = CostMap.build(known, None, width)
        frontier_map = FrontierMap.of(cost, at, task.goal)
        recorded = tick % RECORD == 0
        if frontier_map is not None and frontier_map.frontiers and (policy or recorded):
            if truth is None or truth.frame != known.frame:
                truth = Truth.on(task.world, known.frame)
            if recorded:
                samples.extend(_samples(known, frontier_map, truth, task.goal, rng))
            if policy:
                informed = Informed(truth, frontier_map, 0.5 * (policy - 1), rng)
                cost = with_frontiers(cost, known, at, task.goal, informed)
        return find_route(cost, at, task.goal)

    for _ in walk(task, route_to_goal, LONGEST * task.path_length):
        pass
    return samples


def _samples(
    known: OccupancyGrid,
    frontier_map: FrontierMap,
    truth: Truth,
    goal: tuple[float, float],
    rng: np.random.Generator,
) -> list[tuple[NDArray[Any], ...]]:
    """Return the samples of a map: picture, numbers and size of each frontier."""
    pictures, middles = frontier_pictures(known.whole(), frontier_map.frontiers)
    hidden = np.argwhere(truth.open & ~frontier_map.reached & np.isfinite(frontier_map.costs))
    goals = [(frontier_map.goal, np.array(goal))]
    while len(goals) < GOALS and len(hidden):
        cell = tuple(int(n) for n in hidden[rng.integers(len(hidden))])
        goals.append(((cell[0], cell[1]), np.array(frontier_map.frame.centre(*cell))))
    goals += goals[:1] * (GOALS - len(goals))
    numbers = np.zeros((len(frontier_map.frontiers), GOALS, len(COLUMNS)), dtype=np.float32)
    cells = [frontier_map.frame.cell(*map(float, f.middle)) for f in frontier_map.frontiers]
    numbers[:, :, COLUMNS.index("beyond")] = truth.depths(frontier_map)[:, None]
    for number, (cell, place) in enumerate(goals):
        to_go = costs_from(frontier_map.costs, frontier_map.frame.resolution, cell)
        numbers[:, number, :2] = place - middles
        numbers[:, number, 2] = np.minimum([to_go[at] for at in cells], FARTHEST)
        numbers[:, number, 3:5] = np.transpose(truth.ways(frontier_map, cell))
    sizes = [np.array(len(frontier.points)) for frontier in frontier_map.frontiers]
    return list(zip(pictures, numbers, sizes, strict=True))


def record(config: FrontiersConfig, item: Item) -> tuple[int, str]:
    """Make and write the samples of one building.

    Args:
        config: settings of the samples.
        item: split, and number of the building in it.

    Returns:
        The number of samples; and why there is none, or an empty string.
    """
    split, number = item
    seed = EXPLORATIONS[split] + number
    family = config.families[number % len(config.families)]
    world = generate(family, seed)
    samples, reason = [], ""
    try:
        task = task_in_world(world, seed)
        # Independent of the family, whose position in the list the number decides.
        policy = number // len(config.families) % POLICIES
        samples = explore(task, policy, np.random.default_rng([seed, 3]))
    except NoTaskError as error:
        reason = str(error)
    about = {"family": family, "seed": seed, "world": world_hash(world.grid.cells)}
    pictures, numbers, sizes = zip(*samples, strict=True) if samples else ((), (), ())
    write_frontiers(
        sample_path(config.data, item), pictures, numbers, [float(n) for n in sizes], about
    )
    return len(samples), reason


def make(config: FrontiersConfig, jobs: int) -> None:
    """Make all missing samples, with a progress bar.

    Args:
        config: settings of the samples.
        jobs: number of worker processes.

    Raises:
        UsageError: if the folder holds samples that were made with other settings.
    """
    settings = {"families": list(config.families), "seeds": EXPLORATIONS}
    buildings = {split: getattr(config, split) for split in EXPLORATIONS}
    with ResumableFolder(config.data, settings, exclusive=True):
        make_missing(config.data, buildings, partial(record, config), jobs, "building")
