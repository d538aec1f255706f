"""The frontiers of the observed map, on the cells of the route search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import GridFrame
from planner.guide.route import coarse_costs, costs_from, in_pairs, nearest_cell, open_cell
from planner.risk.cost_map import CostMap

NEIGHBOURS = np.ones((3, 3), dtype=bool)
"""Cells are connected to their eight neighbours, as in the route search."""
UNREACHED_DISTANCE = 40.0
"""Distance of a frontier that cannot be reached [m]."""
START_REACH = 0.8
"""Distance along x and along y within which the car must have a cell that was observed free [m]."""


@dataclass(frozen=True, eq=False)
class FrontierMap:
    """The frontiers of an observed map.

    Attributes:
        frame: position and resolution of the cells.
        start: row and column of the reached cell nearest to the car.
        goal: row and column of the open cell nearest to the goal.
        reached: cells that are connected with the car through cells observed free, (rows, columns).
        costs: cost of a metre in each cell, infinite if no body fits, (rows, columns).
        labels: number of the frontier that a cell belongs to, from 1 on; 0: none, (rows, columns).
        frontiers: the frontiers, in the order of their numbers.
    """

    frame: GridFrame
    start: tuple[int, int]
    goal: tuple[int, int]
    reached: NDArray[np.bool_]
    costs: NDArray[np.float32]
    labels: NDArray[np.integer]
    frontiers: list[Frontier]

    @classmethod
    def of(
        cls, cost: CostMap, position: tuple[float, float], goal: tuple[float, float]
    ) -> FrontierMap | None:
        """Find the frontiers of a map.

        Args:
            cost: cost map of all that was observed.
            position: x, y of the car [m].
            goal: x, y of the goal [m].

        Returns:
            None if the goal is in the reached space or in cells observed occupied, or if no cell
            within `START_REACH` of the car was observed free.
        """
        costs, step = coarse_costs(cost)
        frame = GridFrame(step, cost.frame.origin, costs.shape)
        seen = observed(cost)
        start = nearest_cell(seen, frame, position, round(START_REACH / step))
        end = open_cell(cost, costs, step, goal)
        if start is None or end is None:
            return None
        parts, _ = ndimage.label(seen, NEIGHBOURS)
        reached = parts == parts[start]
        if reached[end]:
            return None
        border = np.isfinite(costs) & ~seen & ndimage.binary_dilation(reached, NEIGHBOURS)
        labels, _ = ndimage.label(border, NEIGHBOURS)
        to_go = costs_from(costs, step, end)
        frontiers = [
            _frontier(np.argwhere(labels[part] == number + 1), part, frame, to_go)
            for number, part in enumerate(ndimage.find_objects(labels))
        ]
        return cls(frame, start, end, reached, costs, labels, frontiers)

    def least(self, costs: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the least of some costs (rows, columns) over the cells of each frontier, (n,)."""
        inside = self.labels > 0
        least = np.full(len(self.frontiers) + 1, np.inf)
        np.minimum.at(least, self.labels[inside], costs[inside])
        # Rarely a diagonal step is closed by a corner, so that a frontier cannot be reached.
        return np.where(np.isfinite(least[1:]), least[1:], UNREACHED_DISTANCE)


def observed(cost: CostMap) -> NDArray[np.bool_]:
    """Return the cells of the route search that hold an observed free cell in which a body fits."""
    return in_pairs((cost.clearance >= cost.required) & ~cost.unseen, np.logical_or)


def _frontier(
    cells: NDArray[np.intp],
    part: tuple[slice, ...],
    frame: GridFrame,
    to_go: NDArray[np.float32],
) -> Frontier:
    """Return the frontier of some cells, given by row and column inside a part of the map."""
    cells = cells + np.array([part[0].start, part[1].start])
    middle = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))]
    points = np.array(frame.origin) + (cells[:, ::-1] + 0.5) * frame.resolution
    centre = np.array(frame.origin) + (middle[::-1] + 0.5) * frame.resolution
    return Frontier(points, centre, float(to_go[middle[0], middle[1]]))
