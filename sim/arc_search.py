"""Search over arcs for the poses that a car without a reverse gear can reach, on the true map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.kernels import njit
from sim.world import World

HEADINGS = 16
"""Number of headings that the search distinguishes."""
CELL = 0.2
"""Side of the squares of positions that the search distinguishes [m]."""
CHECKS = 3
"""Least number of poses on an arc at which the body is tested."""
STRIDE = 0.3
"""Largest distance between these poses [m]; cars that turn in wide arcs need more of them."""
BUCKETS = 64
"""Number of buckets in the ring of the search; it exceeds the cost of any arc."""


class _Circles(NamedTuple):
    """The circles that cover the body.

    Attributes:
        offsets: positions of their centres along the body, (n,) [m].
        needed: clearance that each of them needs [m].
    """

    offsets: NDArray[np.float64]
    needed: float


def search_arcs(
    world: World,
    start: tuple[float, float, float],
    body: Body,
    radius: float,
    clearance: float,
    comfort: float,
    longest: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_]]:
    """Find the cheapest paths from a pose to all poses that a car reaches on forward arcs.

    Args:
        world: building in which the car drives.
        start: x, y, yaw at the start [m, m, rad].
        body: the car's body, which is covered by circles.
        radius: radius of the arcs [m].
        clearance: free space to keep around the circles [m].
        comfort: additional clearance from which on a wall adds no cost [m].
        longest: maximum length of a path [m].

    Returns:
        The same as `explore`.
    """
    frame = world.grid.frame
    offsets, circle = body.circles()
    # Clearances are measured between the centres of cells, up to a diagonal more than the free
    # space.
    needed = circle + clearance + math.sqrt(2.0) * frame.resolution
    field, circles = frame.field(world.clearance), _Circles(offsets, needed)
    return explore(np.array(start), field, circles, radius, comfort, longest)


@njit(cache=True, nogil=True)
def _spare(field, circles, x, y, yaw):  # type: ignore[no-untyped-def]
    """Return the least excess of a circle's clearance over the needed one [m].

    It is negative if a circle is too close to a solid cell, or outside the map.
    """
    clearance, resolution, origin = field
    cos, sin = math.cos(yaw), math.sin(yaw)
    spare = np.inf
    for offset in circles.offsets:
        row = math.floor((y + offset * sin - origin[1]) / resolution)
        col = math.floor((x + offset * cos - origin[0]) / resolution)
        if not (0 <= row < clearance.shape[0] and 0 <= col < clearance.shape[1]):
            return -1.0
        spare = min(spare, clearance[row, col] - circles.needed)
    return spare


@njit(cache=True, nogil=True)
def _along(x, y, yaw, side, part, radius):  # type: ignore[no-untyped-def]
    """Return the pose after a part of an arc to a side: −1, 0 or 1."""
    turn = 2.0 * math.pi / HEADINGS
    half = 0.5 * side * turn * part
    straight = radius * turn * part if side == 0 else 2.0 * radius * math.sin(abs(half))
    end_x, end_y = x + straight * math.cos(yaw + half), y + straight * math.sin(yaw + half)
    return end_x, end_y, yaw + 2.0 * half


@njit(cache=True, nogil=True)
def explore(start, field, circles, radius, comfort, longest):  # type: ignore[no-untyped-def]
    """Find the cheapest paths from a pose, over arcs to the left, straight on and to the right.

    This is Dijkstra's algorithm with a ring of buckets, since costs are small whole numbers. Poses
    are exact: the lattice only decides which of them count as the same, so the car can drive every
    path found. Arcs near walls cost more, so that paths keep to the middle where there is room.

    Args:
        start: x, y, yaw at the start, (3,).
        field: `Field` of the distances to the nearest solid cell [m].
        circles: `_Circles` that cover the body.
        radius: radius of the arcs [m]; an arc turns by one of `HEADINGS`.
        comfort: additional clearance from which on a wall adds no cost [m].
        longest: maximum length of a path [m].

    Returns:
        Poses reached, in the order of cost, (n, 3); index of each pose's parent, −1 for the start,
        (n,); number of arcs from the start to each pose, (n,); and whether each pose is the first
        in its square of positions, (n,).
    """
    turn = 2.0 * math.pi / HEADINGS
    length = radius * turn
    checks = max(CHECKS, math.ceil(length / STRIDE))
    origin = field.origin
    rows = int(field.values.shape[0] * field.resolution / CELL) + 1
    cols = int(field.values.shape[1] * field.resolution / CELL) + 1
    closed = np.zeros((rows, cols, HEADINGS), dtype=np.bool_)
    entered = np.zeros((rows, cols), dtype=np.bool_)

    # All poses ever proposed; each bucket is a list linked through `following`.
    size = 1 << 16
    poses = np.empty((size, 3))
    headings = np.empty(size, dtype=np.int8)
    parents = np.empty(size, dtype=np.int32)
    arcs = np.empty(size, dtype=np.int32)
    following = np.empty(size, dtype=np.int32)
    buckets = np.full(BUCKETS, -1, dtype=np.int32)
    settled = np.empty(size, dtype=np.int32)
    first = np.empty(size, dtype=np.bool_)

    poses[0, 0], poses[0, 1], poses[0, 2] = start[0], start[1], start[2]
    headings[0], parents[0], arcs[0], following[0] = 0, -1, 0, -1
    buckets[0] = 0
    proposed, waiting, done, cost = 1, 1, 0, 0
    while waiting:
        node = buckets[cost % BUCKETS]
        if node < 0:
            cost += 1
            continue
        buckets[cost % BUCKETS] = following[node]
        waiting -= 1
        row = int((poses[node, 1] - origin[1]) / CELL)
        col = int((poses[node, 0] - origin[0]) / CELL)
        if closed[row, col, headings[node]]:
            continue
        closed[row, col, headings[node]] = True
        if done == settled.size:
            settled = np.concatenate((settled, np.empty_like(settled)))
            first = np.concatenate((first, np.empty_like(first)))
        settled[done] = node
        first[done] = not entered[row, col]
        entered[row, col] = True
        done += 1
        if (arcs[node] + 1) * length > longest:
            continue
        if proposed + 3 > headings.size:
            poses = np.concatenate((poses, np.empty_like(poses)))
            headings = np.concatenate((headings, np.empty_like(headings)))
            parents = np.concatenate((parents, np.empty_like(parents)))
            arcs = np.concatenate((arcs, np.empty_like(arcs)))
            following = np.concatenate((following, np.empty_like(following)))
        x, y, yaw = poses[node, 0], poses[node, 1], poses[node, 2]
        for side in range(-1, 2):
            end_x, end_y, end_yaw = _along(x, y, yaw, side, 1.0, radius)
            heading = (headings[node] + side) % HEADINGS
            end_row = int((end_y - origin[1]) / CELL)
            end_col = int((end_x - origin[0]) / CELL)
            # Before the body is tested, which takes longer.
            inside = 0 <= end_row < rows and 0 <= end_col < cols
            if inside and closed[end_row, end_col, heading]:
                continue
            spare = np.inf
            for check in range(1, checks + 1):
                pose = _along(x, y, yaw, side, check / checks, radius)
                spare = min(spare, _spare(field, circles, pose[0], pose[1], pose[2]))
                if spare < 0.0:
                    break
            if spare < 0.0:
                continue
            price = 20 + abs(side) + int(20.0 * max(0.0, 1.0 - spare / comfort))
            poses[proposed, 0], poses[proposed, 1], poses[proposed, 2] = end_x, end_y, end_yaw
            headings[proposed] = heading
            parents[proposed] = node
            arcs[proposed] = arcs[node] + 1
            bucket = (cost + price) % BUCKETS
            following[proposed] = buckets[bucket]
            buckets[bucket] = proposed
            proposed += 1
            waiting += 1

    settled = settled[:done]
    rank = np.full(proposed, -1, dtype=np.int32)
    for i in range(done):
        rank[settled[i]] = i
    settled_parents = np.empty(done, dtype=np.int32)
    for i in range(done):
        parent = parents[settled[i]]
        settled_parents[i] = rank[parent] if parent >= 0 else -1
    return poses[settled], settled_parents, arcs[settled], first[:done].copy()
