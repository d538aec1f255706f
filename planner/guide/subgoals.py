"""Subgoals: the route to the goal by way of the frontier with the least expected cost.

A frontier leads on to the goal, or the car has to come back and try another one. The expected cost
of trying one first follows from Bellman's equation over the sets of frontiers that are left (Stein,
Bradley and Roy: Learned subgoal planning, 2018). It is added to the cells of the frontier, so that
all searches on the cost map take it into account.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from foresee.frontiers import FrontierPredictor, FrontierValues
from foresee.mapping.grid import OccupancyGrid
from planner.guide.frontiers import FrontierMap
from planner.guide.route import costs_from
from planner.risk.cost_map import CostMap

MAX_FRONTIERS = 6
"""Number of frontiers that are compared, the most promising ones: the number of sets of frontiers
grows exponentially."""
TURN_COST = 8.0
"""Cost of turning round after a frontier that did not lead on, in metres of free space."""
GIVE_UP_COST = 40.0
"""Cost if no frontier leads on, in metres: another one, which was not compared, must be tried."""
MIN_PROBABILITY = 0.02
"""Lower bound of the probability by which the most promising frontiers are chosen."""


def with_frontiers(
    cost: CostMap,
    known: OccupancyGrid,
    position: tuple[float, float],
    goal: tuple[float, float],
    predictor: FrontierPredictor,
) -> CostMap:
    """Return the cost map with the expected cost of trying each frontier added to its cells.

    Args:
        cost: cost map of all that was observed.
        known: the observed map.
        position: x, y of the car [m].
        goal: x, y of the goal [m].
        predictor: predictor of frontiers.

    Raises:
        ValueError: if the predictor's values are not of as many frontiers, or out of range.
    """
    frontier_map = FrontierMap.of(cost, position, goal)
    if frontier_map is None or not frontier_map.frontiers:
        return cost
    values = predictor.values(known.whole(), goal, frontier_map.frontiers)
    count = len(frontier_map.frontiers)
    columns = np.array([values.leads, values.way, values.back], dtype=np.float64)
    if columns.shape != (3, count):
        raise ValueError(f"there are {columns.shape[1:]} values of {count} frontiers")
    if not (np.isfinite(columns) & (columns >= 0.0)).all() or (columns[0] > 1.0).any():
        raise ValueError(
            "leads must lie in [0, 1], and way and back must be finite and not negative"
        )
    surcharge = np.append(0.0, _surcharges(frontier_map, columns))
    density = cost.density.copy()
    added = (surcharge[frontier_map.labels] / frontier_map.frame.resolution).astype(np.float32)
    rows, cols = (2 * n for n in added.shape)
    density[:rows, :cols] += added.repeat(2, axis=0).repeat(2, axis=1)
    return replace(cost, density=density)


def _surcharges(frontier_map: FrontierMap, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is added to the cost of crossing each frontier, (n,) [m].

    It is the expected cost of trying the frontier first, less the estimated cost of the cheapest
    route to the goal through it. The least of these differences is subtracted from all.

    Args:
        frontier_map: the frontiers.
        columns: probability to lead on, way and way back of each frontier, (3, n).
    """
    frontiers, frame = frontier_map.frontiers, frontier_map.frame
    border = np.where(frontier_map.reached, frontier_map.costs, np.inf)
    # Unobserved cells of the border cost no more than free ones: the rest is in the values.
    border[frontier_map.labels > 0] = 1.0
    goal = np.array(frame.centre(*frontier_map.goal))
    straight = np.array([np.hypot(*(f.middle - goal)) for f in frontiers])
    leads, way, back = columns
    # No route is shorter than the straight line, whatever is predicted.
    way = np.maximum(way, straight)

    def distances(cell: tuple[int, int]) -> NDArray[np.float64]:
        """Return the distance of each frontier from a cell, through the reached space."""
        return frontier_map.least(costs_from(border, frame.resolution, cell))

    here = distances(frontier_map.start)
    plain = here + np.array([f.to_go for f in frontiers])
    promise = here + way + (1.0 - leads) * (back + TURN_COST) / np.maximum(leads, MIN_PROBABILITY)
    chosen = np.argsort(promise, kind="stable")[:MAX_FRONTIERS]
    middles = [frame.cell(*frontiers[i].middle.tolist()) for i in chosen]
    between = np.array([distances(middle)[chosen] for middle in middles])
    values = FrontierValues(leads[chosen], way[chosen], back[chosen] + TURN_COST)
    expected = expected_costs(here[chosen], between, values)
    # A frontier that is not compared is no better than the worst of those that are.
    total = np.full(len(frontiers), expected.max())
    total[chosen] = expected
    # Only differences decide, and costs of cells must not be negative. A frontier from which the
    # map shows no route to the goal needs no surcharge, since no route crosses it.
    more = np.where(np.isfinite(plain), total - plain, 0.0)
    return np.asarray(more - more.min())


def expected_costs(
    here: NDArray[np.float64], between: NDArray[np.float64], values: FrontierValues
) -> NDArray[np.float64]:
    """Return the expected cost to the goal if each frontier is tried first, (n,) [m].

    Args:
        here: distance of the car from each frontier, (n,) [m].
        between: distances between the frontiers, (n, n) [m].
        values: what is predicted of each frontier; `back` includes the cost of turning round. The
            computing time grows as 2^n.
    """
    count = len(here)

    @cache
    def best(last: int, left: int) -> float:
        """Return the expected cost from a frontier, with the set of frontiers that are left."""
        following = [i for i in range(count) if left >> i & 1]
        return min((tried(between[last, i], i, left) for i in following), default=GIVE_UP_COST)

    def tried(distance: float, i: int, left: int) -> float:
        """Return the expected cost of trying frontier i first, which is at a distance [m]."""
        leads = float(values.leads[i])
        fails = values.back[i] + best(i, left & ~(1 << i)) if leads < 1.0 else 0.0
        return float(distance + leads * values.way[i] + (1.0 - leads) * fails)

    return np.array([tried(here[i], i, (1 << count) - 1) for i in range(count)])
