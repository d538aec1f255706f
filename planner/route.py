"""The route: the cheapest way to the goal over the whole map, by Dijkstra's algorithm."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.costmap import CostMap


def find_route(
    cost: CostMap, start: tuple[float, float], goal: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Vertices (n, 2) [m] from start to goal, or None where seen-occupied space closes all ways.

    The search runs on cells of twice the map's size: such a cell is open where the body fits
    somewhere inside it, and costs its cheapest part.
    """
    rows, cols = (n // 2 * 2 for n in cost.frame.shape)
    fits = cost.clearance[:rows, :cols] >= cost.required
    density = np.where(fits, cost.density[:rows, :cols], np.inf)
    # Cell by cell of the four: numpy is ten times slower over axes of two.
    upper, lower = (np.minimum(row[:, ::2], row[:, 1::2]) for row in (density[::2], density[1::2]))
    coarse = np.minimum(upper, lower)
    step = 2 * cost.frame.resolution
    ends = []
    for x, y in (start, goal):
        row = math.floor((y - cost.frame.origin[1]) / step)
        col = math.floor((x - cost.frame.origin[0]) / step)
        ends.append(_nearest_open(coarse, row, col, math.ceil(0.6 / step)))
    if ends[0] is None or ends[1] is None:
        return None
    cells = _dijkstra(coarse, ends[0][0], ends[0][1], ends[1][0], ends[1][1])
    if len(cells) == 0:
        return None
    points = np.column_stack([
        cost.frame.origin[0] + (cells[:, 1] + 0.5) * step,
        cost.frame.origin[1] + (cells[:, 0] + 0.5) * step,
    ])  # fmt: skip
    # Moving averages take the staircase out without leaving the cells' neighbourhood.
    if len(points) > 4:
        padded = np.vstack([points[:1], points[:1], points, points[-1:], points[-1:]])
        points = np.mean([padded[i : i + len(points)] for i in range(5)], axis=0)
    return np.vstack([np.asarray(start)[None], points[1:-1], np.asarray(goal)[None]])


def _nearest_open(cost: NDArray[np.float32], row: int, col: int, reach: int) -> tuple | None:
    r0, c0 = max(0, row - reach), max(0, col - reach)
    part = cost[r0 : row + reach + 1, c0 : col + reach + 1]
    rows, cols = np.nonzero(np.isfinite(part))
    if len(rows) == 0:
        return None
    i = int(np.argmin((rows + r0 - row) ** 2 + (cols + c0 - col) ** 2))
    return int(rows[i] + r0), int(cols[i] + c0)


@njit(cache=True, nogil=True)
def _dijkstra(cost, start_row, start_col, goal_row, goal_col):  # type: ignore[no-untyped-def]
    """Cells (n, 2) of the cheapest 8-connected way from start to goal; none if there is none.

    A cell's cost is above 0, and infinite where there is no way.
    """
    rows, cols = cost.shape
    # With a border that nothing enters, so that every cell has eight neighbours.
    wide = cols + 2
    price = np.full((rows + 2) * wide, np.inf, dtype=np.float32)
    price.reshape(rows + 2, wide)[1:-1, 1:-1] = cost
    best = np.full(price.size, np.inf, dtype=np.float32)
    towards = np.full(price.size, -1, dtype=np.int32)
    keys = np.empty(1024, dtype=np.float32)
    nodes = np.empty(1024, dtype=np.int32)
    goal = (goal_row + 1) * wide + goal_col + 1
    start = (start_row + 1) * wide + start_col + 1
    best[goal] = 0.0
    keys[0], nodes[0] = 0.0, goal
    count = 1
    straight = np.float32(0.5)
    diagonal = np.float32(0.5) * np.float32(math.sqrt(2.0))
    while count:
        key, node = keys[0], nodes[0]
        count -= 1
        # Sift the last entry down from the heap's top.
        last_key, last_node = keys[count], nodes[count]
        i = 0
        while True:
            child = 2 * i + 1
            if child >= count:
                break
            if child + 1 < count and keys[child + 1] < keys[child]:
                child += 1
            if keys[child] >= last_key:
                break
            keys[i], nodes[i] = keys[child], nodes[child]
            i = child
        keys[i], nodes[i] = last_key, last_node
        if key > best[node]:
            continue
        if node == start:
            break
        if count + 8 > keys.size:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
        for up in (-wide, 0, wide):
            for right in range(-1, 2):
                other = node + up + right
                # Nothing is gained there; the node itself is such a place.
                if best[other] <= key:
                    continue
                half = straight
                if up != 0 and right != 0:
                    # A diagonal step passes both corners.
                    if price[node + up] == np.inf or price[node + right] == np.inf:
                        continue
                    half = diagonal
                value = key + half * (price[node] + price[other])
                if value < best[other]:
                    best[other] = value
                    towards[other] = node
                    i = count
                    count += 1
                    while i > 0:
                        parent = (i - 1) // 2
                        if keys[parent] <= value:
                            break
                        keys[i], nodes[i] = keys[parent], nodes[parent]
                        i = parent
                    keys[i], nodes[i] = value, other
    if start != goal and towards[start] < 0:
        return np.empty((0, 2), dtype=np.int64)
    steps, here = 1, start
    while here != goal:
        here = towards[here]
        steps += 1
    cells = np.empty((steps, 2), dtype=np.int64)
    here = start
    for i in range(steps):
        cells[i, 0], cells[i, 1] = here // wide - 1, here % wide - 1
        here = towards[here]
    return cells
