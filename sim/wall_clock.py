"""Drives on the wall clock: a decision that comes too late is not carried out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.scan import Scan
from sim.driver_protocol import Decision, Driver

D = TypeVar("D", bound=Decision)
"""Type of the driver's decisions."""
D_co = TypeVar("D_co", bound=Decision, covariant=True)


class Withdrawing(Driver[D_co], Protocol[D_co]):
    """A driver that can take back a decision."""

    def withdraw(self) -> None:
        """Take back the decision of the last `step`, which was not carried out."""
        ...


class OnWallClock(Generic[D]):
    """Lets a driver decide once a tick of the wall clock.

    A tick begins when its time has come. A decision is in time if it is there before the next tick
    begins. Otherwise it is withdrawn, since the car is no longer where it would begin; for all
    ticks that it took, the car goes on with what the driver kept before, as `skip` says. The first
    decision may take any time: the car stands.

    Args:
        driver: driver that decides.
        dt: length of a tick [s].
        now: clock [s].
        sleep: function that waits for some time [s].

    Attributes:
        late: number of ticks without a decision in time, so far.
    """

    def __init__(
        self,
        driver: Withdrawing[D],
        dt: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.driver, self.dt, self.late = driver, dt, 0
        self._now, self._sleep = now, sleep
        self._next: float | None = None
        """Time at which the next tick begins [s]; None before the first."""
        self._missed = 0
        """Number of the ticks from the next on that have passed already."""

    @property
    def known(self) -> OccupancyGrid:
        """Map of all that has been observed so far."""
        return self.driver.known

    @property
    def path_counts(self) -> Mapping[str, int]:
        """Number of paths followed so far, see `Driver`."""
        return self.driver.path_counts

    def step(self, state: NDArray[np.float64], scan: Scan) -> D:
        """Return the decision of the tick, or what the driver kept if there is none in time."""
        if self._missed:
            return self.skip()
        if self._next is None:
            decision = self.driver.step(state, scan)
            self._next = self._now() + self.dt
            return decision
        begin = self._next
        self._sleep(max(0.0, begin - self._now()))
        decision = self.driver.step(state, scan)
        ticks = max(1, math.ceil((self._now() - begin) / self.dt - 1e-9))
        if ticks == 1:
            self._next = begin + self.dt
            return decision
        self._missed = ticks
        self.driver.withdraw()
        return self.skip()

    def skip(self) -> D:
        """Go on without a decision, in a tick whose decision is missing."""
        self.late += self._missed > 0
        self._missed = max(self._missed - 1, 0)
        if self._next is not None:
            self._next += self.dt
        return self.driver.skip()
