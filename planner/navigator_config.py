"""The settings of the navigator."""

from __future__ import annotations

from dataclasses import dataclass, field

from foresee.mapping.car_limits import CarLimits
from foresee.mapping.conventions import START_MARGIN
from foresee.mapping.error_bounds import NO_ERRORS, ErrorBounds
from foresee.mapping.finite import check_finite
from planner.guide.guide_config import GuideConfig
from planner.mpc.mpc import MPCConfig

RISK_MAP_AHEAD = 2.5
"""Distance from the car to the centre of the risk map, ahead of the car [m]."""


@dataclass(frozen=True)
class NavigatorConfig:
    """Settings of the navigator and of the modules that it calls.

    Attributes:
        window: side of the square around the car in which a scan changes the map [m].
        expansion: ratio of the predicted square's side to `window`.
        reliance: in [0, 1]: a plan may enter unobserved cells that are predicted free with a
            probability of at least 1 - `reliance`. If the prediction is wrong, the car brakes hard.
        level: in [0, `reliance`]: the last resort may enter unobserved cells that are predicted
            free with a probability of at least 1 - `level` / doubt, see
            `foresee.prediction.Prediction`. If the prediction is wrong, the car may collide. 0: it
            enters observed cells alone.
        adapt: whether the level is lowered while predictions prove wrong, see
            `planner.risk.adaptive_level`.
        steer: whether predictions also change the cost map, and with it the route.
        start_margin: margin around the body at the start in which cells count as observed free [m].
        deadline: longest wait for a prediction [s]; a later one is used from the tick on in which
            it is there. It is far above the usual time, so that
            simulated drives do not depend on the machine's load.
        bounds: bounds of the errors of pose, ranges and motion, for which the car is safe.
        car: the car's limits and body.
        mpc: settings of the MPC.
        guide: settings of path planning.
    """

    window: float = 5.0
    expansion: float = 2.0
    reliance: float = 0.0
    level: float = 0.0
    adapt: bool = True
    steer: bool = False
    start_margin: float = START_MARGIN
    deadline: float = 2.0
    bounds: ErrorBounds = NO_ERRORS
    car: CarLimits = field(default_factory=CarLimits)
    mpc: MPCConfig = field(default_factory=MPCConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)

    def __post_init__(self) -> None:
        if not 0.0 <= self.reliance <= 1.0:
            raise ValueError(f"reliance is {self.reliance}, it must lie in [0, 1]")
        if not 0.0 <= self.level < 1.0:
            raise ValueError(f"level is {self.level}, it must lie in [0, 1)")
        if self.level > 0.0 and not self.level <= self.reliance < 1.0:
            raise ValueError(
                f"level is {self.level}: it must be at most the reliance, which is "
                f"{self.reliance} and must be below 1"
            )
        if not self.expansion >= 1.0:
            raise ValueError(f"expansion is {self.expansion}, it must be at least 1")
        check_finite(self, "window", "deadline")
        check_finite(self, "start_margin", zero=True)

    @property
    def predicted_side(self) -> float:
        """Side of the square that is predicted if the predictor states none [m]: at most what a
        stop from top speed can make use of."""
        return min(self.window * self.expansion, max(10.0, 2 * (self.car.stopping_distance + 1.5)))

    @property
    def risk_side(self) -> float:
        """Side of the risk map [m]: the body, and a stop from top speed, fit into it."""
        room = self.car.body.radius + 0.5
        ahead = self.car.stopping_distance + max(1.0, room) - RISK_MAP_AHEAD
        return max(10.0, 2 * ahead, 2 * (RISK_MAP_AHEAD + room))
