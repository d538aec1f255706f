"""Adaptation of the last resort's level λ during a drive: wrong predictions and doubt lower it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame, OccupancyGrid, paste
from planner.risk.risk_map import RiskMap

SUSTAINED = 0.5
"""Sum of the excess losses (loss - α) that lowers the level from its maximum to 0."""
DOUBT_KEPT = 0.98
"""Factor by which the doubt decays in each tick while the predictor states a smaller one: its
classification of the surroundings can change from tick to tick. The half-life is 3.4 s."""


class AdaptiveLevel:
    """Adapts the level λ of the last resort to how often predictions prove wrong on this drive.

    A cell that the last resort was allowed to enter before it was observed is checked as soon as
    the LIDAR observes it. The loss of a tick is the share of the cells checked in it that are not
    free. After each tick with a check

        λ ← λ + η (α - loss), at most α,

    where α is the allowed level and η = α / `SUSTAINED`. At λ <= 0 the last resort uses observed
    cells alone, and λ grows by ηα in each tick without a check.

    Over any T updates, the losses in ticks with λ > 0 sum to at most αT + `SUSTAINED` + 1, whatever
    the building and the predictions (after Lekeufack et al., "Conformal decision theory", ICRA
    2024). Proof: let μ follow the same rule, but with a loss of 0 in all ticks with λ <= 0. Then
    μ >= λ by induction. Therefore μ falls only from above 0, by at most η, and stays above -η.
    Adding up the updates gives the sum of these losses <= αT + (α + η) / η. The bound is about the
    mean loss over a drive; `planner.risk.calibration` is about the probability of a collision.

    The last resort of a tick uses λ divided by the doubt of the predictor, see `doubted`.

    Cells that leave the square of the risk map before they are observed are never checked.

    Args:
        allowed: α, the level at the start and the highest one, in [0, 1).
        adapts: whether wrong predictions lower the level.
    """

    def __init__(self, allowed: float, adapts: bool = True) -> None:
        self._allowed = self._level = allowed
        self._adapts = adapts
        self._doubt = 1.0
        self._frame: GridFrame | None = None
        self._believed = np.zeros((0, 0), dtype=np.bool_)

    @property
    def level(self) -> float:
        """The level for the next tick at a doubt of 1, in [0, allowed]."""
        return max(self._level, 0.0)

    def doubted(self, doubt: float) -> float:
        """Return the level for this tick: λ divided by the doubt. Call it once per tick.

        A larger doubt of an earlier tick decays by the factor `DOUBT_KEPT` per tick.

        Args:
            doubt: doubt of the prediction of this tick, see `foresee.prediction.Prediction`.
        """
        self._doubt = max(doubt, DOUBT_KEPT * self._doubt)
        return self.level / self._doubt

    def check(self, known: OccupancyGrid) -> None:
        """Check the cells that have been observed since they were allowed, and update the level.

        Args:
            known: map of all that was observed.
        """
        if self._frame is None or not self._adapts:
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
        """Update the level by the loss of a tick, in [0, 1], if it adapts."""
        if not self._adapts:
            return
        step = self._allowed / SUSTAINED
        self._level = min(self._allowed, self._level + step * (self._allowed - loss))

    def believe(self, risk: RiskMap) -> None:
        """Remember the unobserved cells that the last resort may enter in this tick."""
        if self._allowed == 0.0 or not self._adapts:
            return
        believed: NDArray[np.bool_] = risk.certain & risk.known.unknown
        if self._frame is not None:
            believed |= paste(self._frame, self._believed, risk.frame, np.False_)
        self._frame, self._believed = risk.frame, believed
