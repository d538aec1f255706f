"""The contract between a predictor of frontiers and the planner that uses one.

A *frontier* is a connected part of the border between the space that was observed free and can be
reached, and the unobserved space. A predictor of frontiers tells which of them lead on to the goal,
at any distance, and what it costs to find out that one does not (learned subgoal planning, Stein et
al. 2018). Its answer changes the route alone, never what the car may rely on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import Grid


@dataclass(frozen=True, eq=False)
class FrontierValues:
    """What is predicted of each of n frontiers. All numbers are finite and not negative.

    Attributes:
        leads: probability in [0, 1] that a way leads from the frontier to the goal without
            returning to the reached space, (n,).
        way: length of that way, if there is one, (n,) [m].
        back: distance that the car drives beyond the frontier until it has found out that there is
            none, and back, (n,) [m].
    """

    leads: NDArray[np.float64]
    way: NDArray[np.float64]
    back: NDArray[np.float64]


class FrontierPredictor(Protocol):
    """Anything that predicts where frontiers lead."""

    def values(
        self, known: Grid, goal: tuple[float, float], frontiers: Sequence[Frontier]
    ) -> FrontierValues:
        """Predict where frontiers lead.

        Args:
            known: map of all that was observed.
            goal: x, y of the goal [m].
            frontiers: frontiers of this map; at least one.

        If it raises an exception, or if its values are out of range, the route is planned without
        it. It is called where the path searches run, without a deadline: it must not block. With an
        executor of other processes, such as `planner.guide.search_process.SearchProcess`, it is
        pickled and sent there.
        """
        ...
