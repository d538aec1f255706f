"""The level of the last resort while driving: it falls where predictions prove wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.risk.risk_map import RiskMap
from predictor.mapping.grid import GridFrame, OccupancyGrid

SUSTAINED = 0.5
"""Sum of excess losses that takes the level from its most to 0."""


class AdaptiveLevel:
    """Adapts the level λ of the last resort to how often predictions prove wrong in this building.

    What the last resort may rely upon at a tick is checked as soon as the LIDAR sees it. The loss
    of a tick is the share of cells not free among those then checked, 0 if there are none. Then

        λ ← λ + η (α - loss), at most the λ that was allowed,

    and at λ <= 0 the last resort relies on observed cells alone. Since there is no loss then, the
    mean loss over T ticks is at most α + (`SUSTAINED` + 1) / T, whatever the building and the
    predictions (Lekeufack et al., "Conformal decision theory", 2024). This bounds a long-run
    average, and not the chance of a collision in a drive: for that there is the calibration. α is
    the allowed λ itself, and η = λ_max / `SUSTAINED`.

    Args:
        allowed: level that was allowed, λ_max in [0, 1).
    """

    def __init__(self, allowed: float) -> None:
        self._allowed = self._level = allowed
        self._frame: GridFrame | None = None
        self._believed: NDArray[np.bool_] | None = None

    @property
    def level(self) -> float:
        """The level for the next tick, in [0, allowed]."""
        return max(self._level, 0.0)

    def check(self, known: OccupancyGrid) -> None:
        """Compare what was believed at the last tick with what has been observed since."""
        if self._frame is None or self._believed is None:
            return
        now = known.crop(self._frame)
        checked = self._believed & ~now.unknown
        count = int(checked.sum())
        self.update(float(now.occupied[checked].sum()) / count if count else 0.0)
        self._frame = None

    def update(self, loss: float) -> None:
        """Take the loss of a tick, in [0, 1], into account."""
        step = self._allowed / SUSTAINED
        self._level = min(self._allowed, self._level + step * (self._allowed - loss))

    def believe(self, risk: RiskMap) -> None:
        """Remember what the last resort may rely upon at this tick without having observed it."""
        if self._allowed > 0.0:
            self._frame, self._believed = risk.frame, risk.certain & risk.known.unknown
