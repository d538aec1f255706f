"""Simulator: buildings, tasks, the LIDAR, the car, and the closed loop of a drive.

A `world` is the true map of a building. `families` generates buildings: `corridor_network`,
`narrow`, `trap`, `paper`, `office`, `floor_plan`, `maze`, `obstacle_field` and `as_built` draw them
on a `canvas`. `as_built` joins wings (`wing`), furnishes them (`scanned_furniture`), and makes of
them what a robot maps (`robot_map`). `map_server` reads and writes maps as files; `variation`
turns, scales and clutters a building. `task` draws a start and a goal, between which `arc_search`
finds a path; `task_file` reads them from a file. In an `episode`, `lidar` takes a scan, a driver
(`driver_protocol`) decides, and `car` moves, in each tick; `recorder` collects what happens.
`controller` is a simpler protocol for drivers of others, which get what `sight` keeps; `suite` has
sets of tasks that never change; `gym_env` is the loop as an environment of Gymnasium.
`people` walk about in recorded logs: the LIDAR sees them, but they are not in the true map.
"""

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
