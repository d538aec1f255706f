# ruff: noqa: D102  The attributes are described where they are implemented, in the planner.
"""Protocols of the driver: what the closed loop calls, and what it reads of each decision.

`planner.navigator.Navigator` and `planner.decision.Decision` satisfy these protocols. The
simulator does not import the planner, so that it can judge the planner's drives independently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.control import Control
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan

D_co = TypeVar("D_co", bound="Decision", covariant=True)


class Driver(Protocol[D_co]):
    """Decides on the car's control, tick after tick."""

    @property
    def known(self) -> OccupancyGrid:
        """Map of all that has been observed so far."""
        ...

    @property
    def path_counts(self) -> Mapping[str, int]:
        """Number of paths followed so far, by source, of reversals, and of recovery
        manoeuvres."""
        ...

    def step(self, state: NDArray[np.float64], scan: Scan) -> D_co:
        """Decide on the control of the next tick.

        Args:
            state: x, y, yaw, v of the car, (4,) [m, m, rad, m/s].
            scan: LIDAR scan taken at that state.
        """
        ...

    def skip(self) -> D_co:
        """Go on without a decision, in a tick whose decision is missing."""
        ...


class Decision(Protocol):
    """A control, and the reasons for it; `planner.decision.Decision` describes the fields."""

    @property
    def control(self) -> Control: ...
    @property
    def plan(self) -> Plan: ...
    @property
    def last_resort(self) -> NDArray[np.float64]: ...
    @property
    def limit(self) -> str: ...
    @property
    def faults(self) -> Sequence[str]: ...
    @property
    def relied(self) -> NDArray[np.float64]: ...
    @property
    def emergency(self) -> bool: ...
    @property
    def times(self) -> Mapping[str, float]: ...


class Plan(Protocol):
    """A motion: states (N+1, 4), controls (N, 2), and the gear, 1 or -1."""

    @property
    def states(self) -> NDArray[np.float64]: ...
    @property
    def controls(self) -> NDArray[np.float64]: ...
    @property
    def gear(self) -> int: ...
