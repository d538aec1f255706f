"""Simulated logs of a robot in a generated building.

Real logs differ from the paper's simulation not only in the buildings: the
LIDAR sees 180°, with beams half a degree or a degree apart; the scans are up to a metre apart, and
contain walking people; the true map is made of the same scans, so that most rooms behind doors are
missing in it. Networks that predict such maps can be trained on the logs simulated here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.polyline import arc_length, points_at
from predictor.data.laser_log import LaserLog
from sim.lidar import Lidar, LidarConfig
from sim.people import People
from sim.task import Task

ROBOT = CarLimits(v_max=0.5, turning_radius=0.3, body=Body(0.4, 0.4))
"""A car that fits through any door and turns in any room, for planning the robot's way."""
LOOK = 0.2
"""Longest step of the simulation of walking people [s]."""


@dataclass(frozen=True)
class SimulatedLogConfig:
    """Settings of simulated logs; each log draws its own values from them at random.

    Attributes:
        beams: number of beams of a scan over 180°.
        apart: shortest and longest distance from one scan to the next [m].
        noise: standard deviation of the ranges [m].
        dropout: share of beams without a return.
        people: number of walking people per area of floor [1/m²].
        misplaced: standard deviation of the error of each coordinate of the poses [m].
        misturned: standard deviation of the error of the headings [rad].
    """

    beams: tuple[int, ...] = (181, 361)
    apart: tuple[float, float] = (0.1, 1.0)
    noise: tuple[float, ...] = (0.01, 0.02, 0.04)
    dropout: tuple[float, ...] = (0.0, 0.02, 0.1)
    people: tuple[float, ...] = (0.0, 0.0, 0.01, 0.03)
    misplaced: tuple[float, ...] = (0.0, 0.01, 0.03)
    misturned: float = math.radians(0.3)


def simulated_log(
    tasks: list[Task], rng: np.random.Generator, config: SimulatedLogConfig | None = None
) -> LaserLog:
    """Move a robot through a building, and return the log of its LIDAR.

    Args:
        tasks: routes through one building, which are followed one after the other.
        rng: generator of all random values.
        config: settings from which values are drawn; None: the defaults.
    """
    config = config or SimulatedLogConfig()
    lidar = Lidar(
        LidarConfig(
            fov=math.pi,
            beams=int(rng.choice(config.beams)),
            mount=(0, 0, 0),
            range_noise=float(rng.choice(config.noise)),
            dropout=float(rng.choice(config.dropout)),
        )
    )
    apart = float(rng.uniform(*config.apart))
    routes = [np.vstack([task.start[:2], task.waypoints]) for task in tasks]
    poses = np.concatenate([poses_along(route, apart) for route in routes])
    world = tasks[0].world
    crowd = People(world, float(rng.choice(config.people)), poses[0, :2], rng)
    pause = apart / ROBOT.v_max
    steps = math.ceil(pause / LOOK)
    scans = []
    for pose in poses:
        scans.append(lidar.scan(world, pose, rng, crowd.discs))
        for _ in range(steps):
            crowd.walk(pause / steps, pose[:2])
    misplaced = float(rng.choice(config.misplaced))
    sigmas = np.array([misplaced, misplaced, config.misturned if misplaced else 0.0])
    logged = poses + sigmas * rng.standard_normal(poses.shape)
    # The walls of a generated building lie on the edges of cells; those of a real log lie anywhere.
    logged[:, :2] += rng.uniform(0.0, world.grid.frame.resolution, 2)
    return LaserLog(world.name, tuple(scans), logged, None)


def poses_along(points: NDArray[np.float64], apart: float) -> NDArray[np.float64]:
    """Return poses (n, 3) along a route, facing ahead.

    Args:
        points: points of the route, (m, 2) [m].
        apart: distance from one pose to the next [m].
    """
    at = np.arange(0.0, arc_length(points)[-1], apart)
    here = points_at(points, at)
    # The robot faces where it will be a metre later, so that it turns before a bend.
    ahead = points_at(points, at + 1.0) - here
    return np.column_stack([here, np.arctan2(ahead[:, 1], ahead[:, 0])])
