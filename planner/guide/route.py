"""Route search: the cheapest route to the goal on the whole map, by Dijkstra's algorithm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import Field, GridFrame
from foresee.mapping.kernels import njit
from planner.risk.cost_map import CostMap


def find_route(
    cost: CostMap, start: tuple[float, float], goal: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Return the vertices (n, 2) [m] of the cheapest route; None if occupied cells block all.

    The search runs on cells of twice the size of the cost map's, each of which covers four of them.
    It is open if the body fits in one of the four, and costs as much as the cheapest of these.
    """
    coarse, step = coarse_costs(cost)
    ends = [open_cell(cost, coarse, step, point) for point in (start, goal)]
    if ends[0] is None or ends[1] is None:
        return None
    _, towards = _dijkstra(coarse, *ends[0], *ends[1])
    cells = _trace(towards, coarse.shape[1] + 2, *ends[0], *ends[1])
    if len(cells) == 0:
        return None
    points = np.array(cost.frame.origin) + (cells[:, ::-1] + 0.5) * step
    # A moving average smooths the staircase of cells, and stays close to them.
    if len(points) > 4:
        padded = np.vstack([points[:1], points[:1], points, points[-1:], points[-1:]])
        points = np.mean([padded[i : i + len(points)] for i in range(5)], axis=0)
    return np.vstack([np.asarray(start)[None], points[1:-1], np.asarray(goal)[None]])


def cost_to_go(cost: CostMap, goal: tuple[float, float]) -> Field | None:
    """Compute the cost of the route from each cell to the goal, ignoring the turning radius.

    Returns:
        Costs in metres of free space, infinite where there is no route; None if the goal lies in
        cells that were observed occupied.
    """
    coarse, step = coarse_costs(cost)
    end = open_cell(cost, coarse, step, goal)
    if end is None:
        return None
    return Field(costs_from(coarse, step, end), step, cost.frame.origin)


def costs_from(
    costs: NDArray[np.float32], step: float, end: tuple[int, int]
) -> NDArray[np.float32]:
    """Return the cost of the cheapest route between each cell and `end`, (rows, columns) [m].

    Args:
        costs: cost of a metre in each cell, infinite where a cell is closed, (rows, columns).
        step: side of a cell [m].
        end: row and column of a cell.
    """
    best, _ = _dijkstra(costs, -1, -1, *end)
    rows, cols = costs.shape
    return best.reshape(rows + 2, cols + 2)[1:-1, 1:-1] * np.float32(step)


def coarse_costs(cost: CostMap) -> tuple[NDArray[np.float32], float]:
    """Return the costs of cells of twice the size, infinite if no body fits, and their side [m]."""
    fits = cost.clearance >= cost.required
    return in_pairs(np.where(fits, cost.density, np.inf), np.minimum), 2 * cost.frame.resolution


def in_pairs(cells: NDArray[Any], join: np.ufunc) -> NDArray[Any]:
    """Join each two by two cells into one; an odd last row or column is left out."""
    rows, cols = (n // 2 * 2 for n in cells.shape)
    # By pairs of cells, since numpy is ten times slower over axes of length two.
    upper, lower = (
        join(row[:, ::2], row[:, 1::2]) for row in (cells[:rows:2, :cols], cells[1:rows:2, :cols])
    )
    return np.asarray(join(upper, lower))


def open_cell(
    cost: CostMap, coarse: NDArray[np.float32], step: float, point: tuple[float, float]
) -> tuple[int, int] | None:
    """Return row and column of the open cell nearest to a point [m], at most 0.6 m from it along
    each axis; None if there is none."""
    frame = GridFrame(step, cost.frame.origin, coarse.shape)
    return nearest_cell(np.isfinite(coarse), frame, point, math.ceil(0.6 / step))


def nearest_cell(
    wanted: NDArray[np.bool_], frame: GridFrame, point: tuple[float, float], reach: int
) -> tuple[int, int] | None:
    """Return row and column of the wanted cell nearest to a point; None if there is none near it.

    Args:
        wanted: cells to choose from, (rows, columns).
        frame: their position and resolution.
        point: x, y of the point [m].
        reach: largest difference of the rows, and of the columns.
    """
    row = math.floor((point[1] - frame.origin[1]) / frame.resolution)
    col = math.floor((point[0] - frame.origin[0]) / frame.resolution)
    r0, c0 = max(0, row - reach), max(0, col - reach)
    part = wanted[r0 : max(0, row + reach + 1), c0 : max(0, col + reach + 1)]
    rows, cols = np.nonzero(part)
    if len(rows) == 0:
        return None
    i = int(np.argmin((rows + r0 - row) ** 2 + (cols + c0 - col) ** 2))
    return int(rows[i] + r0), int(cols[i] + c0)


@njit(cache=True, nogil=True)
def _dijkstra(cost, start_row, start_col, goal_row, goal_col):  # type: ignore[no-untyped-def]
    """Find the cheapest 8-connected routes to a goal, from one start or from all cells.

    Args:
        cost: cost of each cell, above 0, and infinite where a cell is closed, (rows, columns).
        start_row: row of the start, at which the search ends; -1: all cells are starts.
        start_col: column of the start, or -1.
        goal_row: row of the goal.
        goal_col: column of the goal.

    Returns:
        Cost to go from each cell, in units of a cell's side times its cost, and index of the next
        cell on the route, -1 if there is none. Both are flat arrays over the cells and a border of
        one cell around them.
    """
    rows, cols = cost.shape
    # The border, which no route enters, gives every cell eight neighbours.
    wide = cols + 2
    price = np.full((rows + 2) * wide, np.inf, dtype=np.float32)
    price.reshape(rows + 2, wide)[1:-1, 1:-1] = cost
    best = np.full(price.size, np.inf, dtype=np.float32)
    towards = np.full(price.size, -1, dtype=np.int32)
    keys = np.empty(1024, dtype=np.float32)
    nodes = np.empty(1024, dtype=np.int32)
    goal = (goal_row + 1) * wide + goal_col + 1
    start = (start_row + 1) * wide + start_col + 1 if start_row >= 0 else -1
    best[goal] = 0.0
    keys[0], nodes[0] = 0.0, goal
    count = 1
    straight = np.float32(0.5)
    diagonal = np.float32(0.5) * np.float32(math.sqrt(2.0))
    while count:
        key, node = keys[0], nodes[0]
        count -= 1
        _drop_first(keys, nodes, count)
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
                # Through `node` it is no cheaper for this cell, which may be `node` itself.
                if best[other] <= key:
                    continue
                half = straight
                if up != 0 and right != 0:
                    # A diagonal step must not cut the corner of a closed cell.
                    if price[node + up] == np.inf or price[node + right] == np.inf:
                        continue
                    half = diagonal
                value = key + half * (price[node] + price[other])
                if value < best[other]:
                    best[other] = value
                    towards[other] = node
                    _insert(keys, nodes, count, value, other)
                    count += 1
    return best, towards


@njit(cache=True, nogil=True)
def _drop_first(keys, nodes, last):  # type: ignore[no-untyped-def]
    """Drop a binary heap's first entry: sift its entry number `last` down from the top."""
    key, node = keys[last], nodes[last]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i], nodes[i] = keys[child], nodes[child]
        i = child
    keys[i], nodes[i] = key, node


@njit(cache=True, nogil=True)
def _insert(keys, nodes, i, key, node):  # type: ignore[no-untyped-def]
    """Insert an entry into a binary heap of i entries."""
    while i > 0:
        parent = (i - 1) // 2
        if keys[parent] <= key:
            break
        keys[i], nodes[i] = keys[parent], nodes[parent]
        i = parent
    keys[i], nodes[i] = key, node


@njit(cache=True, nogil=True)
def _trace(towards, wide, start_row, start_col, goal_row, goal_col):  # type: ignore[no-untyped-def]
    """Return row and column of the cells from start to goal, (n, 2); n = 0 if there is no route."""
    start, goal = (start_row + 1) * wide + start_col + 1, (goal_row + 1) * wide + goal_col + 1
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
