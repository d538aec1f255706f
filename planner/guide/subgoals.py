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

MOST = 6
"""Number of frontiers that are compared, the most promising ones: the number of sets of frontiers
grows exponentially."""
TURN = 8.0
"""Cost of turning round after a frontier that did not lead on, in metres of free space."""
GIVE_UP = 40.0
"""Cost if no frontier leads on, in metres: another one, which was not compared, must be tried."""
UNREACHED = 40.0
"""Distance of a frontier to which no way was found [m]."""
UNLIKELY = 0.02
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
    found = FrontierMap.of(cost, position, goal)
    if found is None or not found.frontiers:
        return cost
    values = predictor.values(known.whole(), goal, found.frontiers)
    count = len(found.frontiers)
    columns = np.array([values.leads, values.way, values.back], dtype=np.float64)
    if columns.shape != (3, count):
        raise ValueError(f"there are {columns.shape[1:]} values of {count} frontiers")
    if not (np.isfinite(columns) & (columns >= 0.0)).all() or (columns[0] > 1.0).any():
        raise ValueError(
            "leads must lie in [0, 1], and way and back must be finite and not negative"
        )
    surcharge = np.append(0.0, _surcharges(found, columns))
    density = cost.density.copy()
    added = (surcharge[found.labels] / found.frame.resolution).astype(np.float32)
    rows, cols = (2 * n for n in added.shape)
    density[:rows, :cols] += added.repeat(2, axis=0).repeat(2, axis=1)
    return replace(cost, density=density)


def _surcharges(found: FrontierMap, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is added to the cost of crossing each frontier, (n,) [m].

    It is the expected cost of trying the frontier first, less the estimated cost of the cheapest
    way to the goal through it. The least of these differences is subtracted from all.

    Args:
        found: the frontiers.
        columns: probability to lead on, way and way back of each frontier, (3, n).
    """
    border = np.where(found.reached, found.costs, np.inf)
    # Unobserved cells of the border cost no more than free ones: the rest is in the values.
    border[found.labels > 0] = 1.0
    step = found.frame.resolution
    straight = np.array(
        [np.hypot(*(f.middle - _centre(found, found.goal))) for f in found.frontiers]
    )
    leads, way, back = columns
    # No way is shorter than the straight line, whatever is predicted.
    way = np.maximum(way, straight)
    here = _to_frontiers(found, costs_from(border, step, found.start))
    plain = here + np.array([f.to_go for f in found.frontiers])
    promise = here + way + (1.0 - leads) * (back + TURN) / np.maximum(leads, UNLIKELY)
    chosen = np.argsort(promise, kind="stable")[:MOST]
    between = np.array(
        [_to_frontiers(found, costs_from(border, step, _middle(found, i)))[chosen] for i in chosen]
    )
    values = FrontierValues(leads[chosen], way[chosen], back[chosen] + TURN)
    expected = expected_costs(here[chosen], between, values)
    # A frontier that is not compared is no better than the worst of those that are.
    total = np.full(len(found.frontiers), expected.max())
    total[chosen] = expected
    # Only differences decide, and costs of cells must not be negative. A frontier from which the
    # map shows no way to the goal needs no surcharge, since no route crosses it.
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
        return min((tried(between[last, i], i, left) for i in following), default=GIVE_UP)

    def tried(distance: float, one: int, left: int) -> float:
        leads = float(values.leads[one])
        fails = values.back[one] + best(one, left & ~(1 << one)) if leads < 1.0 else 0.0
        return float(distance + leads * values.way[one] + (1.0 - leads) * fails)

    return np.array([tried(here[i], i, (1 << count) - 1) for i in range(count)])


def _to_frontiers(found: FrontierMap, costs: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the least cost over the cells of each frontier, (n,)."""
    inside = found.labels > 0
    least = np.full(len(found.frontiers) + 1, np.inf)
    np.minimum.at(least, found.labels[inside], costs[inside])
    # Rarely a diagonal step is closed by a corner, so that a frontier cannot be reached.
    return np.where(np.isfinite(least[1:]), least[1:], UNREACHED)


def _middle(found: FrontierMap, number: int) -> tuple[int, int]:
    x, y = found.frontiers[number].middle
    return found.frame.cell(float(x), float(y))


def _centre(found: FrontierMap, cell: tuple[int, int]) -> NDArray[np.float64]:
    return np.array(found.frame.centre(*cell))
