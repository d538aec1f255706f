"""Scenarios of the attack: a hostile predictor, and the building, car and start of its drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.runs.car import limits_for
from benchmarks.runs.settings import Settings
from benchmarks.studies.robustness.hostile_buildings import (
    in_pocket,
    on_lattice,
    resampled,
    task_for,
    with_thin_walls,
)
from benchmarks.studies.robustness.hostile_predictors import KINDS
from benchmarks.studies.robustness.worst_errors import (
    MOST,
    WorstErrors,
    WorstLidar,
    WorstRobot,
    drawn_errors,
)
from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import RESOLUTION, TIGHTEST
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.polyline import arc_length
from sim import Lidar, LidarConfig
from sim.buildings import building, task_in_world
from sim.errors import Robot
from sim.task import Task
from sim.world import World

RELIANCES = (0.0, 0.05, 0.2, 0.5, 0.99)
SPEEDS = (2.0, 4.0, 6.0)
ERROR_SPEEDS = (1.0, 2.0, 4.0, 6.0, 8.0)
"""Top speeds of drives with errors [m/s]."""
ERROR_WINDOWS = (5.0, 5.0, 20.0)
"""Windows of drives with errors [m]: only where the car sees far does it reach such speeds."""
HONEST_ARMS = {"none": "known", "compact": "predicted"}
HONEST = tuple(HONEST_ARMS)
"""Predictors of drives with errors that should reach their goal, with their arms."""
HONEST_EACH = 7
"""One in so many drives with errors has an honest predictor; no divisor of the number of kinds."""
NEAR = 5
"""Number of the waypoint that is the goal of these drives, about 10 m from the start."""
FINEST, COARSEST = 0.01, 0.5
"""Range of the sides of cells [m]."""
CARS = ("dubins", "reeds-shepp", "differential")
"""Kinds of cars that are drawn."""
ODDITIES = ("cells", "thin walls", "body", "pocket", "lattice", "process", "goals")
"""What may be unusual: the size of the cells; walls of one cell; the car's body and turning radius;
a start that the car must leave in reverse; a start and beams in the corners of cells; a predictor
in a process of its own; new goals on the drive."""
SITUATIONS = ("usual", *ODDITIES, "mixed")
"""Kinds of drives: with nothing unusual, with one oddity, or with several at random."""
ROUND = LidarConfig(fov=2.0 * math.pi, beams=1440)
"""LIDAR that looks back, too, without which a car cannot back out. From the corner of a cell, some
of its beams run through the corners of others."""


@dataclass(frozen=True)
class Scenario:
    """What is decided about a drive of the attack before it.

    Attributes:
        index: number of the drive.
        kind: hostile predictor, a key of `KINDS`.
        situation: kind of drive, one of `SITUATIONS`.
        odd: oddities of the drive, of `ODDITIES`.
        settings: settings of the drive.
        resolution: side of a cell [m].
        car: limits of the car.
        worst: how the robot's errors are wrong; None: it has none.
    """

    index: int
    kind: str
    situation: str
    odd: tuple[str, ...]
    settings: Settings
    resolution: float = RESOLUTION
    car: CarLimits = field(default_factory=CarLimits)
    worst: WorstErrors | None = None

    @classmethod
    def draw(
        cls, index: int, seed: int, errors: bool = False, maps: tuple[str, ...] = ()
    ) -> Scenario:
        """Return the scenario of a drive.

        Args:
            index: number of the drive.
            seed: seed of the first building.
            errors: whether the robot has errors; then some predictors are honest.
            maps: map files of real buildings, in which one in four of these drives takes place.
        """
        rng = np.random.default_rng([seed, index])
        # Kinds and families take turns, so that each pair comes once before any is repeated; all
        # other settings are drawn at random.
        kind = list(KINDS)[index % len(KINDS)]
        family = FAMILIES[(index // len(KINDS) + index) % len(FAMILIES)]
        route, vehicle = str(rng.choice(("free", "fixed"))), str(rng.choice(CARS))
        situation = str(rng.choice(SITUATIONS))
        odd = tuple(
            oddity
            for oddity in ODDITIES
            if oddity == situation or (situation == "mixed" and rng.random() < 0.5)
        )
        if {"pocket", "lattice"} & set(odd):
            # The prescribed route begins at the usual start.
            route = "free"
        settings = Settings(
            world=(family,),
            route=route,
            episodes=1,
            seed=seed + index,
            arms=("predicted",),
            predictor="none",
            reliance=float(rng.choice(RELIANCES)),
            v_max=float(rng.choice(SPEEDS)),
            vehicle="reeds-shepp" if "pocket" in odd and vehicle == "dubins" else vehicle,
        )
        car, resolution = limits_for(settings), RESOLUTION
        if "body" in odd:
            car = _odd_car(car, rng)
        if "cells" in odd:
            resolution = _log_uniform(FINEST, COARSEST, rng)
        drawn = cls(index, kind, situation, odd, settings, resolution, car)
        return drawn._with_errors(seed, maps) if errors else drawn

    def _with_errors(self, seed: int, maps: tuple[str, ...]) -> Scenario:
        """Return the same scenario with errors of the robot, and at times an honest predictor."""
        rng = np.random.default_rng([seed, self.index, 1])
        honest = self.index % HONEST_EACH == 0
        kind = HONEST[self.index // HONEST_EACH % len(HONEST)] if honest else self.kind
        situation, odd, car = self.situation, self.odd, self.car
        settings = replace(
            self.settings, v_max=float(rng.choice(ERROR_SPEEDS)), **drawn_errors(rng)
        )
        if honest:
            situation, odd = "usual", ()
            settings = replace(settings, reliance=Settings.reliance, arms=(HONEST_ARMS[kind],))
            settings = replace(settings, predictor=kind)
        if maps and situation == "usual" and rng.random() < 0.5:
            settings = replace(settings, world=(str(rng.choice(maps)),))
        settings = replace(settings, window=float(rng.choice(ERROR_WINDOWS)))
        limits = limits_for(settings)
        car = replace(car, v_max=limits.v_max) if "body" in odd else limits
        return replace(
            self,
            kind=kind,
            situation=situation,
            odd=odd,
            settings=settings,
            resolution=RESOLUTION if honest else self.resolution,
            car=car,
            worst=WorstErrors.draw(rng),
        )

    @property
    def honest(self) -> bool:
        """Whether the predictor is honest: the car should reach a goal nearby."""
        return self.kind in HONEST

    def task(self) -> Task:
        """Return the task of the drive.

        Raises:
            NoTaskError: if the building has no room for it.
        """
        seed, rng = self.settings.seed, np.random.default_rng([self.settings.seed, 4])
        world = building(self.settings.world[0], seed)
        if self.honest:
            return _shortened(task_in_world(world, seed))
        if self.situation == "usual":
            return task_in_world(world, seed)
        if self.resolution != world.grid.frame.resolution:
            world = resampled(world, self.resolution, rng)
        if "thin walls" in self.odd:
            world = with_thin_walls(world, rng)
        task = task_for(world, seed, self.car)
        if "lattice" in self.odd:
            task = on_lattice(task, self.car.body, rng)
        if "pocket" in self.odd:
            task = in_pocket(task, self.car.body, rng)
        return task

    @property
    def lidar(self) -> Lidar:
        """The LIDAR of the drive."""
        config = ROUND if {"pocket", "lattice"} & set(self.odd) else LidarConfig()
        if "lattice" in self.odd:
            config = replace(config, mount=(0.0, 0.0, 0.0))
        if self.worst is None:
            return Lidar(config)
        config = replace(config, dropout=self.settings.dropout)
        return WorstLidar(config, self.worst.range, self.settings.bounds.range)

    def robot(self, world: World, rng: np.random.Generator) -> Robot | None:
        """Return the errors of the robot; None: it has none."""
        if self.worst is None:
            return None
        return WorstRobot(self.worst, self.settings, world, rng)

    def without_errors(self) -> Scenario:
        """Return the same scenario without errors of the robot."""
        exact: dict[str, Any] = {name: getattr(Settings, name) for name in MOST}
        return replace(self, settings=replace(self.settings, **exact), worst=None)


def _shortened(task: Task) -> Task:
    """Return a task whose goal is one of the first waypoints of another."""
    waypoints = task.waypoints[:NEAR]
    length = float(arc_length(np.vstack([task.start[:2], waypoints]))[-1])
    goal = (float(waypoints[-1, 0]), float(waypoints[-1, 1]))
    return replace(task, goal=goal, waypoints=waypoints, path_length=length)


def _odd_car(car: CarLimits, rng: np.random.Generator) -> CarLimits:
    """Return a car with another body, and a turning radius from the least that is admitted on."""
    body = Body(_log_uniform(0.1, 2.0, rng), _log_uniform(0.08, 1.0, rng))
    least = 1.01 * body.radius / TIGHTEST
    return replace(car, body=body, turning_radius=_log_uniform(least, max(least, 3.0), rng))


def _log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    return round(math.exp(rng.uniform(math.log(low), math.log(high))), 4)
