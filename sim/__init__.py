"""The world that the robot drives in: maps, generated buildings, the LIDAR, the car, the task."""

from sim.car import CarConfig, DubinsCar, PaperCar, collides
from sim.lidar import Lidar, LidarConfig
from sim.world import World

__all__ = [
    "CarConfig",
    "DubinsCar",
    "Lidar",
    "LidarConfig",
    "PaperCar",
    "World",
    "collides",
]
