"""Small maps for the tests of planning: rooms with walls, and what planning reads of them."""

import math

import numpy as np

from foresee.mapping.body import Scene, first_contact
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame, OccupancyGrid
from planner.risk.cost_map import CostMap
from planner.risk.risk_map import RiskMap
from sim.world import World

CAR = CarLimits()
RESOLUTION = 0.05


class Room:
    """A rectangle of free space inside walls of 0.2 m, its lower-left corner at (0, 0)."""

    def __init__(self, width, height, inside=FREE):
        rows, cols = (round(side / RESOLUTION) + 8 for side in (height, width))
        self.frame = GridFrame(RESOLUTION, (-0.2, -0.2), (rows, cols))
        self.cells = np.full(self.frame.shape, OCCUPIED, np.int8)
        self.x, self.y = self.frame.centres()
        self.fill((0.0, width), (0.0, height), inside)

    def fill(self, along, up, value=OCCUPIED):
        """Give a box, from and to along x and y [m], one value; returns the room."""
        inside_x = (self.x > along[0]) & (self.x < along[1])
        inside_y = (self.y > up[0]) & (self.y < up[1])
        self.cells[np.ix_(inside_y, inside_x)] = value
        return self

    @property
    def known(self) -> OccupancyGrid:
        return OccupancyGrid.from_grid(Grid(self.frame, self.cells), 5.0)

    @property
    def cost(self) -> CostMap:
        return CostMap.build(self.known, None, CAR.body.half_width)

    @property
    def world(self) -> World:
        return World("room", Grid(self.frame, self.cells))

    def near(self, x, y) -> RiskMap:
        known = self.known
        return RiskMap.from_prediction(known.crop(known.frame.square(x, y, 10.0)), None, 0.0)

    def meets(self, poses, blocked=None, body=CAR.body) -> bool:
        """Whether the body meets a cell, by default an occupied one, at any pose (n, 3)."""
        blocked = self.cells == OCCUPIED if blocked is None else blocked
        poses = np.ascontiguousarray(np.atleast_2d(poses), dtype=np.float64)
        return bool(first_contact(Scene(blocked, *self.frame.lattice, *body.halves), poses) >= 0)


def along(points) -> np.ndarray:
    """Poses (n, 3) of a body that runs along a polyline (n, 2), heading where it leads."""
    steps = np.diff(points, axis=0, append=2 * points[-1:] - points[-2:-1])
    return np.column_stack([points, np.arctan2(steps[:, 1], steps[:, 0])])


def length(points) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def wrapped(angle):
    """The same angle in [-π, π]."""
    return np.remainder(np.asarray(angle) + math.pi, 2 * math.pi) - math.pi
