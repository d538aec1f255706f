"""The shortest path of a disc through a building, and the lower bound T_bound that it gives.

A disc whose radius is half the body's width fits wherever the body does. Therefore no drive is
shorter than the shortest path of the disc's centre, or faster than full acceleration and then top
speed along that path.
"""

from __future__ import annotations

import heapq
import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from foresee.infra.errors import LineError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.kernels import njit
from sim.world import World

SLACK = 1e-4
"""Depth to which the disc may enter a wall [m]: above rounding errors, and otherwise negligible."""
STRIDE = 0.02
"""Distance of the points of a line at which the disc is tested near walls [m]."""
DIRECTIONS = 36
"""Number of places around a wall's corner where a path may bend."""
NEAR = 0.08
"""Distance from the disc up to which corners of walls are used to shorten a path [m]."""
ROUNDS = 4
"""Largest number of times that a path is shortened."""

Room = tuple[NDArray[np.bool_], NDArray[np.float64], float, NDArray[np.float64], float]
"""Map and disc, as an argument of kernels: solid cells (rows, columns), distance from each cell's
centre to the nearest solid cell's (rows, columns) [m], side of a cell [m], lower-left corner (2,)
[m], and radius of the disc [m]."""


class NoPathError(LineError):
    """There is no path from start to goal for a disc of this radius; the message is one line."""


def time_bound(length: float, car: CarLimits, goal_radius: float) -> float:
    """Return the least time T_bound for a path [s], with full acceleration up to the top speed.

    Args:
        length: length of the shortest path to the goal [m].
        car: limits of the car.
        goal_radius: distance from the goal at which a drive ends [m].
    """
    distance = max(0.0, length - goal_radius)
    rising = 0.5 * car.v_max**2 / car.acceleration
    if distance <= rising:
        return math.sqrt(2.0 * distance / car.acceleration)
    return car.v_max / car.acceleration + (distance - rising) / car.v_max


def path_length(path: NDArray[np.float64]) -> float:
    """Return the length of a polyline (n, 2) [m]."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def shortest_path(
    world: World, start: tuple[float, float], goal: tuple[float, float], radius: float
) -> NDArray[np.float64]:
    """Find the shortest path of a disc's centre to a goal, with the whole map known.

    Lazy Theta* (Nash, Koenig and Tovey 2010) over the cells decides on which side obstacles are
    passed. The path is then shortened by a search among the points at the disc's radius around
    nearby corners of walls. A gap that is less than a cell wider than the disc may be missed.

    Args:
        world: building; all cells that are not free are solid.
        start: x, y of the start [m].
        goal: x, y of the goal [m].
        radius: radius of the disc [m].

    Returns:
        Points from start to goal, (n, 2) [m], n ≥ 2; arcs around corners are polylines.

    Raises:
        NoPathError: if there is no path.
        ValueError: if the radius is negative or not finite.
    """
    if not 0.0 <= radius < math.inf:
        raise ValueError(f"radius is {radius} m, it must be finite and at least 0")
    frame, solid = world.grid.frame, world.solid
    room: Room = (solid, world.clearance, frame.resolution, np.array(frame.origin), radius)
    ends = np.array([start[:2], goal], dtype=np.float64)
    for name, point in zip(("start", "goal"), ends, strict=True):
        if not sees(room, point, point):
            raise NoPathError(f"{world.name}: a disc of {radius:g} m does not fit at the {name}")
    path = _any_angle(~_blocked(solid, radius / frame.resolution), room, ends[0], ends[1])
    if len(path) == 0:
        raise NoPathError(f"{world.name}: no path for a disc of {radius:g} m")
    corners = _corners(world)
    length = math.inf
    for _ in range(ROUNDS):
        if length - path_length(path) < 1e-3:
            break
        length = path_length(path)
        near = corners[_distances(corners, path) < radius + NEAR]
        points = np.vstack([ends, path[1:-1], _around(near, room)])
        path = points[_taut(points, length + 1e-9, room)]
    return path


def _blocked(solid: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Return the cells at whose centre a disc of a radius [cells] would overlap a solid cell."""
    reach = math.ceil(radius + 0.5)
    beside = np.maximum(np.abs(np.arange(-reach, reach + 1)) - 0.5, 0.0)
    disc = np.hypot(beside[:, None], beside) < radius
    disc[reach, reach] = True
    # All is solid outside of the map.
    padded = np.pad(solid, reach, constant_values=True)
    grown = np.asarray(binary_dilation(padded, disc))
    return grown[reach:-reach, reach:-reach]


def _corners(world: World) -> NDArray[np.float64]:
    """Return the convex corners of the walls, (n, 2) [m]."""
    frame = world.grid.frame
    s = np.pad(world.solid, 1, constant_values=True)
    a, b, c, d = s[:-1, :-1], s[:-1, 1:], s[1:, :-1], s[1:, 1:]
    count = a.astype(np.int8) + b + c + d
    rows, cols = np.nonzero((count == 1) | ((count == 2) & (a == d)))
    return np.stack([cols, rows], axis=1) * frame.resolution + np.array(frame.origin)


def _around(corners: NDArray[np.float64], room: Room) -> NDArray[np.float64]:
    """Return free places of the disc's centre around corners, (n, 2) [m]."""
    angles = 2.0 * math.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    # Slightly farther out, so that lines from one point to the next do not cut the circle.
    reach = room[-1] / math.cos(math.pi / DIRECTIONS)
    ring = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = (corners[:, None] + ring).reshape(-1, 2)
    fits = [bool(sees(room, point, point)) for point in points]
    return points[np.array(fits, dtype=bool)]


def _distances(points: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances of points (n, 2) from a polyline (m, 2) [m]."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(path):
        ab = b - a
        along = np.clip((points - a) @ ab / max(float(ab @ ab), 1e-12), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(points - a - along[:, None] * ab).T))
    return best


@njit(cache=True, nogil=True)
def _meets(solid, resolution, origin, x, y, radius):  # type: ignore[no-untyped-def]
    """Return whether a disc at x, y overlaps a solid cell, or leaves the map."""
    u, v, reach = (x - origin[0]) / resolution, (y - origin[1]) / resolution, radius / resolution
    for row in range(math.floor(v - reach), math.floor(v + reach) + 1):
        for col in range(math.floor(u - reach), math.floor(u + reach) + 1):
            inside = 0 <= row < solid.shape[0] and 0 <= col < solid.shape[1]
            if not inside or solid[row, col]:
                dx = max(0.0, col - u, u - col - 1.0)
                dy = max(0.0, row - v, v - row - 1.0)
                if dx * dx + dy * dy < reach * reach:
                    return True
    return False


@njit(cache=True, nogil=True)
def sees(room, a, b):  # type: ignore[no-untyped-def]
    """Return whether a disc can move straight from a to b, both (2,) [m], in a `Room`."""
    solid, clearance, resolution, origin, radius = room
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    done = 0.0
    while True:
        part = done / length if length > 0.0 else 0.0
        x, y = a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])
        row = math.floor((y - origin[1]) / resolution)
        col = math.floor((x - origin[0]) / resolution)
        if not (0 <= row < solid.shape[0] and 0 <= col < solid.shape[1]):
            return False
        # The clearance is from centre to centre: half a cell's diagonal is subtracted at both ends.
        spare = clearance[row, col] - 1.4143 * resolution - radius
        if spare <= 0.0 and _meets(solid, resolution, origin, x, y, radius - SLACK):
            return False
        if done >= length:
            return True
        done = min(length, done + max(spare, STRIDE))


@njit(cache=True, nogil=True)
def _any_angle(free, room, start, goal):  # type: ignore[no-untyped-def]
    """Return a path (n, 2) [m] by Lazy Theta* over free cells; (0, 2) if there is none."""
    _, _, resolution, origin, _ = room
    rows, cols = free.shape
    # The first two nodes are the start and the goal, all others are cells.
    root, end = 0, 1
    cost = np.full(rows * cols + 2, np.inf)
    parent = np.full(rows * cols + 2, -1, dtype=np.int64)
    closed = np.zeros(rows * cols + 2, dtype=np.bool_)
    a, b = np.empty(2), np.empty(2)
    cost[root], parent[root] = 0.0, root
    heap = [(math.hypot(goal[0] - start[0], goal[1] - start[1]), root)]
    while len(heap) > 0:
        _, node = heapq.heappop(heap)
        if closed[node]:
            continue
        _place(node, cols, resolution, origin, start, goal, a)
        if node != root:
            _place(parent[node], cols, resolution, origin, start, goal, b)
            if not sees(room, b, a):
                # The line that was assumed free is not: use the best closed neighbour as parent.
                best, at = np.inf, -1
                row, col = _cell(a, resolution, origin)
                for i in range(row - 1, row + 2):
                    for j in range(col - 1, col + 2):
                        other = 2 + i * cols + j
                        if 0 <= i < rows and 0 <= j < cols and closed[other] and other != node:
                            _place(other, cols, resolution, origin, start, goal, b)
                            reached = cost[other] + math.hypot(a[0] - b[0], a[1] - b[1])
                            if reached < best and sees(room, b, a):
                                best, at = reached, other
                cost[node], parent[node] = best, at
                if at < 0:
                    continue
        closed[node] = True
        if node == end:
            break
        row, col = _cell(a, resolution, origin)
        up = node if node == root else parent[node]
        _place(up, cols, resolution, origin, start, goal, b)
        for i in range(row - 1, row + 2):
            for j in range(col - 1, col + 2):
                if not (0 <= i < rows and 0 <= j < cols and free[i, j]):
                    continue
                other = 2 + i * cols + j
                if closed[other]:
                    continue
                x = origin[0] + (j + 0.5) * resolution
                y = origin[1] + (i + 0.5) * resolution
                reached = cost[up] + math.hypot(x - b[0], y - b[1])
                if reached < cost[other]:
                    cost[other], parent[other] = reached, up
                    ahead = math.hypot(goal[0] - x, goal[1] - y)
                    heapq.heappush(heap, (reached + ahead, other))
        if math.hypot(goal[0] - a[0], goal[1] - a[1]) <= 1.5 * resolution:
            reached = cost[up] + math.hypot(goal[0] - b[0], goal[1] - b[1])
            if reached < cost[end]:
                cost[end], parent[end] = reached, up
                heapq.heappush(heap, (reached, end))
    if not closed[end]:
        return np.empty((0, 2))
    count, node = 1, end
    while node != root:
        node = parent[node]
        count += 1
    path, node = np.empty((count, 2)), end
    for k in range(count - 1, -1, -1):
        _place(node, cols, resolution, origin, start, goal, a)
        path[k, 0], path[k, 1] = a[0], a[1]
        node = parent[node]
    return path


@njit(cache=True, nogil=True, inline="always")
def _cell(point, resolution, origin):  # type: ignore[no-untyped-def]
    row = math.floor((point[1] - origin[1]) / resolution)
    return row, math.floor((point[0] - origin[0]) / resolution)


@njit(cache=True, nogil=True)
def _place(node, cols, resolution, origin, start, goal, out):  # type: ignore[no-untyped-def]
    """Write the position of a node of `_any_angle` into `out`, (2,) [m]."""
    if node < 2:
        end = start if node == 0 else goal
        out[0], out[1] = end[0], end[1]
    else:
        out[0] = origin[0] + ((node - 2) % cols + 0.5) * resolution
        out[1] = origin[1] + ((node - 2) // cols + 0.5) * resolution


@njit(cache=True, nogil=True)
def _taut(points, limit, room):  # type: ignore[no-untyped-def]
    """Return the indices (m,) of the shortest path among points (n, 2), from point 0 to point 1.

    Only paths shorter than `limit` [m] are followed; there must be one.
    """
    count = len(points)
    cost = np.full(count, np.inf)
    parent = np.full(count, -1, dtype=np.int64)
    closed = np.zeros(count, dtype=np.bool_)
    cost[0] = 0.0
    while not closed[1]:
        node, best = -1, np.inf
        for i in range(count):
            if not closed[i]:
                ahead = math.hypot(points[1, 0] - points[i, 0], points[1, 1] - points[i, 1])
                if cost[i] + ahead < best:
                    node, best = i, cost[i] + ahead
        closed[node] = True
        for i in range(count):
            if not closed[i]:
                step = math.hypot(points[i, 0] - points[node, 0], points[i, 1] - points[node, 1])
                ahead = math.hypot(points[1, 0] - points[i, 0], points[1, 1] - points[i, 1])
                promising = cost[node] + step < min(cost[i], limit - ahead)
                if promising and sees(room, points[node], points[i]):
                    cost[i], parent[i] = cost[node] + step, node
    order = [1]
    while order[-1] != 0:
        order.append(parent[order[-1]])
    return np.array(order[::-1])
