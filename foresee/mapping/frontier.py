"""A frontier: a part of the border between observed and unobserved space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Frontier:
    """A connected part of the border of the observed space.

    Attributes:
        points: centres of its cells, all unobserved, (n, 2) [m].
        middle: the one of these points that is nearest to their mean, (2,) [m].
        to_go: cost of the cheapest way from there to the goal on the cost map, on which unobserved
            space can be crossed [m]. The way may lead back through observed space.
    """

    points: NDArray[np.float64]
    middle: NDArray[np.float64]
    to_go: float
