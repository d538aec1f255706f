"""The moment of a drive: one tick in full, for a figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import GridFrame
from planner.decision import Decision
from sim.recorder import SHAPES as SHAPES_OF_TICKS

SHAPES = SHAPES_OF_TICKS | {
    # A frame is the resolution, and x and y of the origin [m]; probabilities are in 1/255.
    "moment_tick": (),
    "moment_frame": (3,),
    "moment_known": ("any", "any"),
    "moment_safe": "moment_known",
    "moment_plan": ("any", 4),
    "moment_path": ("any", 2),
    "moment_prediction_frame": (3,),
    "moment_p_free": ("any", "any"),
    "moment_p_occupied": "moment_p_free",
    "moment_confidence": "moment_p_free",
    # What the predictor expected, and where, see `benchmarks.runs.beliefs.Beliefs`.
    "beliefs": ("T", "any", "any"),
    "belief_corners": ("T", 2),
}
"""As `sim.recorder.SHAPES`, also for the arrays of the moment and of the beliefs."""
EARLY_TICK, FEW_CELLS = 40, 40
"""Tick that is chosen if no tick before it relied on `FEW_CELLS` unobserved cells or more."""


class Moment:
    """Observes a drive, and keeps the tick that relies on most unobserved cells, or an early one.

    Attributes:
        tick: number of the tick, from 0.
        decision: decision in this tick; None before the first tick.
    """

    def __init__(self) -> None:
        self.tick = 0
        self.decision: Decision | None = None

    def observe(self, tick: int, decision: Decision) -> None:
        """Keep the decision of a tick if it suits a figure better than the one kept so far."""
        most = -1 if self.decision is None else len(self.decision.relied)
        if len(decision.relied) > most or (tick == EARLY_TICK and most < FEW_CELLS):
            self.tick, self.decision = tick, decision

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the moment by name, see `SHAPES`; none before the first tick."""
        if self.decision is None:
            return {}
        risk, prediction = self.decision.risk_map, self.decision.prediction
        path = self.decision.path
        out: dict[str, NDArray[Any]] = {
            "moment_tick": np.array(self.tick),
            "moment_frame": _frame_array(risk.frame),
            "moment_known": risk.known.cells,
            "moment_safe": risk.safe,
            "moment_plan": self.decision.plan.states.astype(np.float32),
            "moment_path": np.empty((0, 2), np.float32),
        }
        if path is not None:
            out["moment_path"] = path.points.astype(np.float32)
        if prediction is not None:
            out["moment_prediction_frame"] = _frame_array(prediction.frame)
            for name in ("p_free", "p_occupied", "confidence"):
                values = np.rint(255 * getattr(prediction, name)).astype(np.uint8)
                out[f"moment_{name}"] = values
        return out


def _frame_array(frame: GridFrame) -> NDArray[np.float64]:
    """Return a frame as an array of resolution, x and y of its origin, (3,) [m]."""
    return np.array([frame.resolution, *frame.origin])
