"""Scenarios of the attack: a hostile predictor, and the building, car and start of its drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

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
from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import RESOLUTION, TIGHTEST
from foresee.mapping.family_names import FAMILIES
from sim import Lidar, LidarConfig
from sim.buildings import task_in_world
from sim.families import generate
from sim.task import Task

RELIANCES = (0.0, 0.05, 0.2, 0.5, 0.99)
SPEEDS = (2.0, 4.0, 6.0)
FINEST, COARSEST = 0.01, 0.5
"""Range of the sides of cells [m]."""
CARS = ("dubins", "reeds-shepp")
"""Kinds of cars that are drawn."""
ODDITIES = ("cells", "thin walls", "body", "pocket", "lattice", "process")
"""What may be unusual: the size of the cells; walls of one cell; the car's body and turning radius;
a start that the car must leave in reverse; a start and beams in the corners of cells; a predictor
in a process of its own."""
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
    """

    index: int
    kind: str
    situation: str
    odd: tuple[str, ...]
    settings: Settings
    resolution: float = RESOLUTION
    car: CarLimits = field(default_factory=CarLimits)

    @classmethod
    def draw(cls, index: int, seed: int) -> Scenario:
        """Return the scenario of a drive.

        Args:
            index: number of the drive.
            seed: seed of the first building.
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
            vehicle="reeds-shepp" if "pocket" in odd else vehicle,
        )
        car, resolution = limits_for(settings), RESOLUTION
        if "body" in odd:
            car = _odd_car(car, rng)
        if "cells" in odd:
            resolution = _log_uniform(FINEST, COARSEST, rng)
        return cls(index, kind, situation, odd, settings, resolution, car)

    def task(self) -> Task:
        """Return the task of the drive.

        Raises:
            NoTaskError: if the building has no room for it.
        """
        seed, rng = self.settings.seed, np.random.default_rng([self.settings.seed, 4])
        world = generate(self.settings.world[0], seed)
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
        if "lattice" in self.odd:
            return Lidar(replace(ROUND, mount=(0.0, 0.0, 0.0)))
        return Lidar(ROUND if "pocket" in self.odd else None)


def _odd_car(car: CarLimits, rng: np.random.Generator) -> CarLimits:
    """Return a car with another body, and a turning radius from the least that is admitted on."""
    body = Body(_log_uniform(0.1, 2.0, rng), _log_uniform(0.08, 1.0, rng))
    least = 1.01 * body.radius / TIGHTEST
    return replace(car, body=body, turning_radius=_log_uniform(least, max(least, 3.0), rng))


def _log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    return round(math.exp(rng.uniform(math.log(low), math.log(high))), 4)
