"""Hybrid A* (Dolgov et al. 2010): search for a path of arcs, in one gear or both.

Poses stay exact; the lattice only decides which of them count as the same. The car can therefore
drive every path found. The heuristic is the cost to go on the grid, which ignores the turning
radius.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Scene, meets
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from foresee.mapping.kernels import njit
from planner.guide.route import cost_to_go
from planner.motion.dynamics import pose_along
from planner.motion.goal import PATH_GOAL_RADIUS
from planner.risk.cost_map import STUCK_REACH, CostMap, around

HEADINGS = 48
"""Number of headings that the lattice distinguishes."""
CELL = 0.125
"""Side of the squares of positions that the lattice distinguishes [m]."""
ARC_LENGTH, CHECKS = 0.25, 3
"""Length of an arc [m], and number of poses on it at which the body is tested."""
SHARES = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
"""Curvatures of the arcs, as shares of that of the tightest arc."""


@dataclass(frozen=True)
class HybridConfig:
    """Settings of the hybrid A* search.

    Attributes:
        slack: ratio of the tightest arc's radius to the car's turning radius; it leaves the car
            room to correct errors.
        margin: margins around the body, tried in this order [m].
        reversing: cost of a metre in reverse, relative to a metre forward.
        shift: cost of a change of gear, in metres of free space.
        steering: cost of a metre on the tightest arc, relative to a straight metre.
        nodes: number of expanded nodes after which the search gives up.
    """

    slack: float = 1.05
    margin: tuple[float, ...] = (0.06, 0.025)
    reversing: float = 3.0
    shift: float = 1.0
    steering: float = 1.3
    nodes: int = 60_000


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a path that is driven in one gear.

    Attributes:
        poses: x, y, yaw along the leg, (n, 3) [m, m, rad].
        gear: 1 forward, -1 in reverse.
    """

    poses: NDArray[np.float64]
    gear: int


class _Settings(NamedTuple):
    """Settings of `_search`; `HybridConfig` describes those that it has, too.

    Attributes:
        curvature: curvature of the tightest arc [1/m].
        reverse: whether the car has a reverse gear.
    """

    reversing: float
    shift: float
    steering: float
    nodes: int
    curvature: float
    reverse: bool


def find_legs(
    cost: CostMap,
    known: OccupancyGrid,
    pose: NDArray[np.float64],
    goal: tuple[float, float],
    onward: float,
    stuck: NDArray[np.float64],
    car: CarLimits,
    config: HybridConfig,
) -> list[Leg]:
    """Find the cheapest path of arcs that brings the car some metres nearer to the goal.

    Args:
        cost: cost map.
        known: observed map. Forward, the body keeps out of cells observed occupied; in reverse, it
            enters only cells observed free.
        pose: x, y, yaw at the start, (3,) or more.
        goal: x, y of the goal [m].
        onward: reduction of the cost to go at which the search ends [m]; infinite: it ends at the
            goal.
        stuck: points at which the car got stuck, (k, 2) [m]; unobserved cells around them count as
            occupied.
        car: the car's limits and body; arcs in reverse are searched if it has a reverse gear.
        config: settings of the search.

    Returns:
        Legs of the path, in order; an empty list if there is no path.
    """
    to_go = cost_to_go(cost, goal)
    if to_go is None:
        return []
    fields = to_go, cost.frame.field(cost.density)
    start = np.asarray(pose, dtype=np.float64)[:3]
    cells = known.cells
    for x, y in stuck:
        here = cells[around(known.frame, float(x), float(y), STUCK_REACH)]
        here[here == UNKNOWN] = OCCUPIED
    settings = _Settings(
        config.reversing,
        config.shift,
        config.steering,
        config.nodes,
        curvature=1.0 / (config.slack * car.turning_radius),
        reverse=car.reverse > 0.0,
    )
    for margin in config.margin:
        body = *known.frame.lattice, *car.body.inflated(margin).halves
        scenes = Scene(cells > 0, *body), Scene(cells != 0, *body)
        poses, gears = _search(start, goal, onward, *fields, scenes, settings)
        if len(gears):
            return _legs(poses, gears)
    return []


def _legs(poses: NDArray[np.float64], gears: NDArray[np.int64]) -> list[Leg]:
    ends = [0, *(np.flatnonzero(np.diff(gears)) + 1), len(gears)]
    return [
        Leg(poses[a * CHECKS : b * CHECKS + 1], int(gears[a])) for a, b in itertools.pairwise(ends)
    ]


@njit(cache=True, nogil=True)
def _search(start, goal, onward, to_go, cost, scenes, settings):  # type: ignore[no-untyped-def]
    """Search for a path of arcs.

    Args:
        start: x, y, yaw at the start, (3,).
        goal: x, y of the goal [m].
        onward: reduction of the cost to go at which the search ends [m].
        to_go: `Field` of the costs to go [m].
        cost: `Field` of the costs of a metre.
        scenes: obstacles and body in forward gear, and in reverse.
        settings: `_Settings` of the search.

    Returns:
        Poses (CHECKS·n + 1, 3) along n arcs, and the arcs' gears (n,); n = 0: no path.
    """
    # For each node: its pose, the cost from the start, its parent, and the arc that leads to it.
    # The arrays have room for the largest number of nodes; the system provides memory only for
    # what is written.
    size = 1 + 2 * SHARES.size * settings.nodes
    poses = np.empty((size, 3))
    spent = np.empty(size)
    parents = np.empty(size, dtype=np.int64)
    gears = np.empty(size, dtype=np.int64)
    shares = np.empty(size)
    closed = set()
    closed.add(np.int64(-1))
    poses[0] = start
    spent[0], parents[0], gears[0], shares[0] = 0.0, -1, 1, 0.0
    start_cost = _remaining(to_go, start[0], start[1])
    if not start_cost < np.inf:
        # No route leads on from the start's cell, as with the front at a wall. With this value, the
        # search ends at the first pose in a cell from which one does.
        start_cost = 1e6
    queue = [(start_cost, 0)]
    count, expanded = 1, 0
    while len(queue) > 0 and expanded < settings.nodes:
        _, node = heapq.heappop(queue)
        x, y, yaw = poses[node, 0], poses[node, 1], poses[node, 2]
        key = _key(cost, x, y, yaw, gears[node])
        if key in closed:
            continue
        closed.add(key)
        expanded += 1
        remaining = _remaining(to_go, x, y)
        near = math.hypot(x - goal[0], y - goal[1]) < PATH_GOAL_RADIUS
        if node > 0 and (near or (gears[node] > 0 and remaining <= start_cost - onward)):
            return _trace(node, poses, parents, gears, shares, settings.curvature)
        for direction in range(2 if settings.reverse else 1):
            gear, scene = 1 - 2 * direction, scenes[direction]
            for share in SHARES:
                kappa = share * settings.curvature
                hit, ex, ey, eyaw = _drive(scene, x, y, yaw, kappa, gear, node == 0)
                if hit or not _inside(cost, ex, ey):
                    continue
                remaining = _remaining(to_go, ex, ey)
                if not remaining < np.inf:
                    remaining = start_cost
                row, col = _cell(cost, cost.resolution, ex, ey)
                steering = 1.0 + (settings.steering - 1.0) * abs(share)
                price = ARC_LENGTH * cost.values[row, col] * steering
                if gear < 0:
                    price *= settings.reversing
                if node > 0 and gear != gears[node]:
                    price += settings.shift
                price += 0.1 * abs(share - shares[node])
                poses[count, 0], poses[count, 1], poses[count, 2] = ex, ey, eyaw
                spent[count] = spent[node] + price
                parents[count], gears[count], shares[count] = node, gear, share
                heapq.heappush(queue, (spent[count] + remaining, count))
                count += 1
    return np.empty((0, 3)), np.empty(0, dtype=np.int64)


@njit(cache=True, nogil=True)
def _key(cost, x, y, yaw, gear):  # type: ignore[no-untyped-def]
    """Return the number of the lattice's cell of a pose and a gear."""
    cols = int(cost.values.shape[1] * cost.resolution / CELL) + 1
    row, col = _cell(cost, CELL, x, y)
    heading = math.floor((yaw / (2.0 * math.pi)) * HEADINGS + 0.5) % HEADINGS
    return ((np.int64(row) * cols + col) * HEADINGS + heading) * 2 + (1 if gear > 0 else 0)


@njit(cache=True, nogil=True)
def _drive(scene, x, y, yaw, kappa, gear, is_first):  # type: ignore[no-untyped-def]
    """Return whether the body meets a blocked cell on an arc, and the pose at the arc's end."""
    ex, ey, eyaw = x, y, yaw
    for check in range(1, CHECKS + 1):
        ex, ey, eyaw = pose_along(x, y, yaw, kappa, gear * ARC_LENGTH * check / CHECKS)
        # A car that starts too close to an obstacle must be able to leave.
        if (not is_first or check == CHECKS) and meets(scene, ex, ey, eyaw):
            return True, ex, ey, eyaw
    return False, ex, ey, eyaw


@njit(cache=True, nogil=True)
def _inside(cost, x, y):  # type: ignore[no-untyped-def]
    """Return whether a point lies both on the lattice and on the cost map."""
    rows, cols = cost.values.shape
    row, col = _cell(cost, CELL, x, y)
    last_row, last_col = int(rows * cost.resolution / CELL), int(cols * cost.resolution / CELL)
    if not (0 <= row <= last_row and 0 <= col <= last_col):
        return False
    row, col = _cell(cost, cost.resolution, x, y)
    return 0 <= row < rows and 0 <= col < cols


@njit(cache=True, nogil=True, inline="always")
def _cell(cost, side, x, y):  # type: ignore[no-untyped-def]
    """Return row and column of a point, on cells of a side [m]; just outside counts as inside."""
    return int((y - cost.origin[1]) / side), int((x - cost.origin[0]) / side)


@njit(cache=True, nogil=True)
def _trace(node, poses, parents, gears, shares, curvature):  # type: ignore[no-untyped-def]
    """Return the poses along the arcs from the start to a node, and the arcs' gears."""
    steps, end = 0, node
    while parents[node] >= 0:
        steps += 1
        node = parents[node]
    path, chosen = np.empty((CHECKS * steps + 1, 3)), np.empty(steps, dtype=np.int64)
    path[0] = poses[0]
    node = end
    for i in range(steps - 1, -1, -1):
        before = parents[node]
        chosen[i] = gears[node]
        x, y, yaw = poses[before, 0], poses[before, 1], poses[before, 2]
        for check in range(1, CHECKS + 1):
            part = gears[node] * ARC_LENGTH * check / CHECKS
            path[CHECKS * i + check] = pose_along(x, y, yaw, shares[node] * curvature, part)
        node = before
    return path, chosen


@njit(cache=True, nogil=True, inline="always")
def _remaining(to_go, x, y):  # type: ignore[no-untyped-def]
    """Return the cost to go from a point [m of free space], infinite off the map."""
    costs, side, origin = to_go
    row, col = math.floor((y - origin[1]) / side), math.floor((x - origin[0]) / side)
    if 0 <= row < costs.shape[0] and 0 <= col < costs.shape[1]:
        return float(costs[row, col])
    return np.inf
