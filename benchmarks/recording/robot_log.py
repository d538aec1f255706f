"""A robot's log as simulation has it: what a physical set would hold, of a generated building.

The logs of docs/datasets.md differ from the paper's simulation in more than the buildings. Their
LIDAR sees 180°, in beams half a degree or a degree apart; what was kept of them are scans up to a
metre apart; people walk through them; and what they call the truth is a map made of those very
scans, in which most of what lies behind a door was never seen. A network that is to predict such
maps can be shown such maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from predictor.data.laser_log import LaserLog
from predictor.mapping.body import Body
from predictor.mapping.car_limits import CarLimits
from sim.lidar import Lidar, LidarConfig
from sim.people import People
from sim.task import Task

ROBOT = CarLimits(v_max=0.5, turning_radius=0.3, body=Body(0.4, 0.4))
"""Which way such a robot could go: through any door, and round in any room."""
LOOK = 0.2
"""Longest that people walk before they look where they are going [s]."""


@dataclass(frozen=True)
class LogConfig:
    """How a log is made; each log draws its own from these.

    Attributes:
        beams: of a scan over 180°.
        apart: shortest and longest way from one scan to the next [m].
        noise: standard deviation of the ranges [m].
        dropout: share of the beams that nothing came back of.
        people: who walk about, on a square metre of floor [1/m²].
        misplaced: standard deviation of the poses, each coordinate [m].
        misturned: standard deviation of the headings [rad].
    """

    beams: tuple[int, ...] = (181, 361)
    apart: tuple[float, float] = (0.1, 1.0)
    noise: tuple[float, ...] = (0.01, 0.02, 0.04)
    dropout: tuple[float, ...] = (0.0, 0.02, 0.1)
    people: tuple[float, ...] = (0.0, 0.0, 0.01, 0.03)
    misplaced: tuple[float, ...] = (0.0, 0.01, 0.03)
    misturned: float = math.radians(0.3)


def simulated_log(
    tasks: list[Task], rng: np.random.Generator, config: LogConfig | None = None
) -> LaserLog:
    """Take a robot through a building, and log what its LIDAR sees.

    Args:
        tasks: ways through one building, one after the other.
        rng: decides all that is drawn.
        config: what is drawn from.
    """
    config = config or LogConfig()
    lidar = Lidar(LidarConfig(fov=math.pi, beams=int(rng.choice(config.beams)), mount=(0, 0, 0),
                              range_noise=float(rng.choice(config.noise)),
                              dropout=float(rng.choice(config.dropout))))  # fmt: skip
    apart = float(rng.uniform(*config.apart))
    ways = [np.vstack([task.start[:2], task.waypoints]) for task in tasks]
    poses = np.concatenate([poses_along(way, apart) for way in ways])
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
    # A building's walls lie on the edges of its cells; those of a log lie anywhere, and so do those
    # of the map that is made of it.
    logged[:, :2] += rng.uniform(0.0, world.grid.frame.resolution, 2)
    return LaserLog(world.name, tuple(scans), logged, None)


def poses_along(points: NDArray[np.float64], apart: float) -> NDArray[np.float64]:
    """Poses (n, 3) along a way of points (m, 2), looking ahead, so far apart [m]."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(0.0, along[-1], apart)
    # Looks to where it will be a little later, so that it turns before a bend and not at it.
    here, there = (
        np.stack([np.interp(where, along, points[:, axis]) for axis in (0, 1)], axis=1)
        for where in (at, np.minimum(at + 1.0, along[-1]))
    )
    ahead = there - here
    return np.column_stack([here, np.arctan2(ahead[:, 1], ahead[:, 0])])
