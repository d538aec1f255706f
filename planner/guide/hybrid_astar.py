"""Hybrid A*: a way over arcs, in one gear or both, for where sampling finds none.

Poses stay exact, the lattice only decides which of them count as the same (Dolgov et al. 2010), so
every way found can be driven. The cost to go over the grid, without regard to turning, is the
heuristic.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.guide.route import cost_to_go
from planner.motion.dynamics import pose_along
from planner.motion.goal import PATH_REACHES
from planner.risk.cost_map import STUCK_REACH, CostMap
from predictor.mapping.body import meets
from predictor.mapping.car_limits import CarLimits
from predictor.mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from predictor.mapping.kernels import njit

HEADINGS = 48
"""Directions that the search tells apart."""
CELL = 0.125
"""Side of the squares of positions that it tells apart [m]."""
STEP, CHECKS = 0.25, 3
"""Length of an arc [m], and the poses on it at which the body is tested."""
SHARES = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
"""Curvatures of the arcs, as shares of the tightest."""


@dataclass(frozen=True)
class HybridConfig:
    """Settings of the search.

    Attributes:
        slack: of the arcs' turning radius over the car's: leaves it room to correct.
        margin: around the body [m], the wider first.
        reversing: price of a metre in reverse, over one forward.
        shift: price of a change of gear [m].
        steering: price of a metre on the tightest arc, over a straight one.
        nodes: looked at before it gives up.
    """

    slack: float = 1.05
    margin: tuple[float, ...] = (0.06, 0.025)
    reversing: float = 3.0
    shift: float = 1.0
    steering: float = 1.3
    nodes: int = 60_000


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a way in one gear.

    Attributes:
        poses: (n, 3) x, y, yaw [m, m, rad].
        gear: 1 forward, -1 in reverse.
    """

    poses: NDArray[np.float64]
    gear: int


def find_legs(
    cost: CostMap,
    known: OccupancyGrid,
    pose: NDArray[np.float64],
    goal: tuple[float, float],
    ahead: float,
    stuck: NDArray[np.float64],
    car: CarLimits,
    config: HybridConfig,
) -> list[Leg]:
    """The cheapest way that brings the car some metres nearer to the goal.

    Args:
        cost: what a metre of way costs.
        known: what has been seen: forward the body keeps out of what is occupied, in reverse in
            what is free.
        pose: x, y, yaw, (3,) or more.
        goal: x, y [m].
        ahead: by how much the cost to go is to fall [m]; infinite: to the goal.
        stuck: points (k, 2) [m] at which the car could not go on: around them it keeps out of what
            has not been seen.
        car: what it can do; it has a reverse gear if its speed in it is not 0.
        config: settings.

    Returns:
        The legs; none where there is no way.
    """
    field = cost_to_go(cost, goal)
    if field is None:
        return []
    to_go, side = field
    cells = known.cells
    for x, y in stuck:
        row, col = known.frame.cell(float(x), float(y))
        n = round(STUCK_REACH / known.frame.resolution)
        here = cells[max(0, row - n) : row + n + 1, max(0, col - n) : col + n + 1]
        here[here == UNKNOWN] = OCCUPIED
    curvature = 1.0 / (config.slack * car.turning_radius)
    for margin in config.margin:
        body = car.body.inflated(margin)
        poses, gears = _search(
            np.asarray(pose, dtype=np.float64)[:3], goal, ahead, to_go, side, cost.density,
            cost.frame.resolution, cost.frame.origin, cells, known.frame.resolution,
            known.frame.origin, body.half_length, body.half_width, curvature, car.reverse > 0.0,
            config.reversing, config.shift, config.steering, config.nodes,
        )  # fmt: skip
        if len(gears):
            return _legs(poses, gears)
    return []


def _legs(poses: NDArray[np.float64], gears: NDArray[np.int64]) -> list[Leg]:
    ends = [0, *(np.flatnonzero(np.diff(gears)) + 1), len(gears)]
    return [Leg(poses[a * CHECKS : b * CHECKS + 1], int(gears[a]))
            for a, b in itertools.pairwise(ends)]  # fmt: skip


@njit(cache=True, nogil=True)
def _search(  # type: ignore[no-untyped-def]
    start, goal, ahead, to_go, side, density, coarse, origin, cells, fine, fine_origin, half_length,
    half_width, curvature, both, reversing, shift, steering, limit,
):  # fmt: skip
    """Poses (CHECKS·n + 1, 3) along n arcs, and their gears (n,); no arcs where there is no way."""
    none = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    rows, cols = (
        int(density.shape[0] * coarse / CELL) + 1,
        int(density.shape[1] * coarse / CELL) + 1,
    )
    occupied, unfree = cells > 0, cells != 0
    size = 1 << 14
    poses = np.empty((size, 3))
    spent = np.empty(size)
    parents = np.empty(size, dtype=np.int64)
    gears = np.empty(size, dtype=np.int64)
    shares = np.empty(size)
    closed = set()
    closed.add(np.int64(-1))
    poses[0] = start
    spent[0], parents[0], gears[0], shares[0] = 0.0, -1, 1, 0.0
    begun = _remaining(start[0], start[1], to_go, side, origin)
    if not begun < np.inf:
        # Off the map's ways, such as with the nose at a wall: from the nearest place on them.
        begun = 1e6
    queue = [(begun, 0)]
    count, looked, found = 1, 0, -1
    while len(queue) > 0 and looked < limit:
        _, node = heapq.heappop(queue)
        x, y, yaw = poses[node, 0], poses[node, 1], poses[node, 2]
        row, col = int((y - origin[1]) / CELL), int((x - origin[0]) / CELL)
        heading = math.floor((yaw / (2.0 * math.pi)) * HEADINGS + 0.5) % HEADINGS
        key = ((np.int64(row) * cols + col) * HEADINGS + heading) * 2 + (
            1 if gears[node] > 0 else 0
        )
        if key in closed:
            continue
        closed.add(key)
        looked += 1
        left = _remaining(x, y, to_go, side, origin)
        near = math.hypot(x - goal[0], y - goal[1]) < PATH_REACHES
        if node > 0 and (near or (gears[node] > 0 and left <= begun - ahead)):
            found = node
            break
        for direction in range(2 if both else 1):
            gear = 1 if direction == 0 else -1
            blocked = occupied if gear > 0 else unfree
            for share in SHARES:
                kappa = share * curvature
                ex, ey, eyaw = x, y, yaw
                hit = False
                for check in range(1, CHECKS + 1):
                    ex, ey, eyaw = pose_along(x, y, yaw, kappa, gear * STEP * check / CHECKS)
                    if meets(blocked, fine, fine_origin, ex, ey, eyaw, half_length, half_width):
                        # It may start closer to something than it likes, and must be able to leave.
                        hit = node > 0 or check == CHECKS
                        if hit:
                            break
                if hit:
                    continue
                r, c = int((ey - origin[1]) / CELL), int((ex - origin[0]) / CELL)
                if not (0 <= r < rows and 0 <= c < cols):
                    continue
                left = _remaining(ex, ey, to_go, side, origin)
                if not left < np.inf:
                    left = begun
                dr, dc = int((ey - origin[1]) / coarse), int((ex - origin[0]) / coarse)
                if not (0 <= dr < density.shape[0] and 0 <= dc < density.shape[1]):
                    continue
                price = STEP * density[dr, dc] * (1.0 + (steering - 1.0) * abs(share))
                if gear < 0:
                    price *= reversing
                if node > 0 and gear != gears[node]:
                    price += shift
                price += 0.1 * abs(share - shares[node])
                if count == spent.size:
                    poses = np.concatenate((poses, np.empty_like(poses)))
                    spent = np.concatenate((spent, np.empty_like(spent)))
                    parents = np.concatenate((parents, np.empty_like(parents)))
                    gears = np.concatenate((gears, np.empty_like(gears)))
                    shares = np.concatenate((shares, np.empty_like(shares)))
                poses[count, 0], poses[count, 1], poses[count, 2] = ex, ey, eyaw
                spent[count] = spent[node] + price
                parents[count], gears[count], shares[count] = node, gear, share
                heapq.heappush(queue, (spent[count] + left, count))
                count += 1
    if found < 0:
        return none
    steps, node = 0, found
    while parents[node] >= 0:
        steps += 1
        node = parents[node]
    way, chosen = np.empty((CHECKS * steps + 1, 3)), np.empty(steps, dtype=np.int64)
    node = found
    for i in range(steps - 1, -1, -1):
        before = parents[node]
        chosen[i] = gears[node]
        for check in range(1, CHECKS + 1):
            way[CHECKS * i + check] = pose_along(
                poses[before, 0], poses[before, 1], poses[before, 2], shares[node] * curvature,
                gears[node] * STEP * check / CHECKS,
            )  # fmt: skip
        node = before
    way[0] = start
    return way, chosen


@njit(cache=True, nogil=True, inline="always")
def _remaining(x, y, to_go, side, origin):  # type: ignore[no-untyped-def]
    """The cost to go from a point, infinite off the map."""
    row, col = math.floor((y - origin[1]) / side), math.floor((x - origin[0]) / side)
    if 0 <= row < to_go.shape[0] and 0 <= col < to_go.shape[1]:
        return float(to_go[row, col])
    return np.inf
