"""The simulator: maps, generated buildings, the LIDAR, the car, the task, the closed loop."""

from sim.car import DubinsCar, collides
from sim.families import empty_straight, generate
from sim.lidar import Lidar, LidarConfig, cast_rays
from sim.map_server import MapError, load_world, save_world
from sim.task import NoTaskError, Task, sample_task
from sim.world import World

__all__ = [
    "DubinsCar",
    "Lidar",
    "LidarConfig",
    "MapError",
    "NoTaskError",
    "Task",
    "World",
    "cast_rays",
    "collides",
    "empty_straight",
    "generate",
    "load_world",
    "sample_task",
    "save_world",
]
