"""The level of the last resort while driving: it falls where predictions prove wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.risk.risk_map import RiskMap
from predictor.mapping.grid import GridFrame, OccupancyGrid, paste

SUSTAINED = 0.5
"""Sum of excess losses that takes the level from its most to 0."""


class AdaptiveLevel:
    """Adapts the level λ of the last resort to how often predictions prove wrong on this drive.

    A cell that the last resort was allowed to rely upon without having been observed is checked
    when the LIDAR observes it, if it still lies in the square of the risk map. The loss of a tick
    is the share of cells not free among those checked in it. After each tick with a check

        λ ← λ + η (α - loss), at most the λ that was allowed,

    where α is the allowed λ itself and η = α / `SUSTAINED`. At λ <= 0 the last resort relies on
    observed cells alone, and λ grows by ηα in each tick without a check.

    Over any T updates, the losses in ticks with λ > 0 sum to at most αT + `SUSTAINED` + 1, whatever
    the building and the predictions (after Lekeufack et al., "Conformal decision theory", ICRA
    2024). Proof: let μ follow the same rule, with the losses in ticks with λ <= 0 set to 0. Then
    μ >= λ by induction, so μ falls only from above 0, by at most η, and stays above -η. Adding up
    the updates gives the sum of these losses <= αT + (α + η) / η. The bound is about the mean over
    a drive. For the chance of a collision in a drive, there is the calibration.

    Cells that leave the square of the risk map before they are observed are never checked.

    Args:
        allowed: level that was allowed, in [0, 1).
    """

    def __init__(self, allowed: float) -> None:
        self._allowed = self._level = allowed
        self._frame: GridFrame | None = None
        self._believed = np.zeros((0, 0), dtype=np.bool_)

    @property
    def level(self) -> float:
        """The level for the next tick, in [0, allowed]."""
        return max(self._level, 0.0)

    def check(self, known: OccupancyGrid) -> None:
        """Compare what was believed with what has been observed since."""
        if self._frame is None:
            return
        now = known.crop(self._frame)
        checked = self._believed & ~now.unknown
        self._believed &= now.unknown
        count = int(checked.sum())
        if count:
            self.update(float(now.occupied[checked].sum()) / count)
        elif self._level <= 0.0:
            self.update(0.0)

    def update(self, loss: float) -> None:
        """Take the loss of a tick, in [0, 1], into account."""
        step = self._allowed / SUSTAINED
        self._level = min(self._allowed, self._level + step * (self._allowed - loss))

    def believe(self, risk: RiskMap) -> None:
        """Remember what the last resort may rely upon at this tick without having observed it."""
        if self._allowed == 0.0:
            return
        believed: NDArray[np.bool_] = risk.certain & risk.known.unknown
        if self._frame is not None:
            believed |= paste(self._frame, self._believed, risk.frame, np.False_)
        self._frame, self._believed = risk.frame, believed
