"""A short drive along a straight corridor, and what drives it."""

import numpy as np

from foresee.mapping.grid import OccupancyGrid
from planner.navigator import Navigator
from planner.navigator_config import NavigatorConfig
from sim import DubinsCar, Lidar, LidarConfig, Task, empty_straight
from sim.episode import EpisodeConfig, run_episode

LENGTH = 16.0
LIDAR = Lidar(LidarConfig(beams=541))


def straight() -> Task:
    """A short straight corridor, driven from one end to the other."""
    world = empty_straight(LENGTH, 3.0)
    start, goal = (2.0, 2.0, 0.0), (LENGTH - 1.0, 2.0)
    return Task(world, start, goal, np.array([goal]), goal[0] - start[0], 0)


def navigator(task: Task, predictor=None, **changes) -> Navigator:
    config = NavigatorConfig(**changes)
    known = OccupancyGrid(task.world.grid.frame, config.window)
    return Navigator(config, predictor, np.array(task.start), task.goal, known, seed=task.seed)


def drive(task: Task, driver: Navigator, config: EpisodeConfig | None = None):
    rng = np.random.default_rng(0)
    return run_episode(task, driver, DubinsCar(), LIDAR, config or EpisodeConfig(), rng)
