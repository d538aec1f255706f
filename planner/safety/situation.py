"""The situation of a tick, for which a plan is chosen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.motion.path import Path
from planner.risk.risk_map import RiskMap
from planner.safety.tube import EXACT, Tube


@dataclass(frozen=True, eq=False)
class Situation:
    """The situation of a tick, for which a plan is chosen.

    Attributes:
        state: x, y, yaw, v of the car when the control acts, mirrored in reverse, (4,).
        risk: newest risk map around the car.
        path: path to follow, or None.
        segment: index of the path's segment near which the car is.
        on_leg: whether the path is a leg of a recovery manoeuvre, at whose end the car stops.
        tube: how far the car may be from plans that begin with this state.
    """

    state: NDArray[np.float64]
    risk: RiskMap
    path: Path | None
    segment: int
    on_leg: bool
    tube: Tube = EXACT
