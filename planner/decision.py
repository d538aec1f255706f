"""The decision of a tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.control import Control
from foresee.prediction import Prediction
from planner.fault import Fault
from planner.motion.path import Path
from planner.motion.plan import Plan
from planner.risk.risk_map import RiskMap
from planner.safety.limiting_factor import Limit


@dataclass(frozen=True, eq=False)
class Decision:
    """The decision of a tick, and the reasons for it.

    Attributes:
        control: control for one tick.
        plan: plan of which the control is the first step.
        last_resort: controls a, κ of the manoeuvre that stops the car if a prediction is wrong or
            no decision follows, (N, 2); its first step is that of the plan.
        limit: what keeps the car from going faster.
        faults: faults that were handled in this tick, each once.
        relied: centres of the unobserved cells that the body sweeps on the plan, (k, 2) [m].
        emergency: whether no plan is safe on the newest map, so that the car brakes as hard as it
            can.
        times: duration of each stage [ms], by name; "cycle" is the time from scan to control, and
            "path" that of path planning, which mostly follows the control. In a tick without a
            decision they are those of the decision that came too late, or there are none.
        risk_map: risk map on which the plan was tested.
        prediction: the predictor's newest answer, or None.
        path: path that the plan follows, or None.
    """

    control: Control
    plan: Plan
    last_resort: NDArray[np.float64]
    limit: Limit
    faults: tuple[Fault, ...]
    relied: NDArray[np.float64]
    emergency: bool
    times: dict[str, float]
    risk_map: RiskMap
    prediction: Prediction | None
    path: Path | None

    @property
    def speed(self) -> float:
        """Speed of the car when the control begins to act, negative in reverse [m/s].

        It differs from the measured one if the control acts later than the scan is taken: until
        then, the car follows the controls that were sent before.
        """
        return float(self.plan.states[0, 3])
