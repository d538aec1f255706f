"""A predictor in a process of its own that answers within the deadline from the start."""

from __future__ import annotations

from foresee.prediction import Prediction, View
from planner.risk.predictor_process import PredictorProcess
from predictor.registry import load_predictor


class PromptPredictor(PredictorProcess):
    """Runs a predictor in a process of its own, and never waits longer than the deadline.

    A new `Navigator` waits minutes for its first prediction, since a predictor may have to load. A
    node must not, in its first tick: once `is_warm` is set, the first wait is as short as others.

    Args:
        name: name of the predictor.
        deadline: longest wait for a prediction once it is warm [s].

    Raises:
        BadPredictionError: if the predictor cannot be made.
    """

    def __init__(self, name: str, deadline: float) -> None:
        super().__init__(load_predictor, name)
        self.is_warm, self._deadline = False, deadline

    def ask(self, view: View, patience: float) -> Prediction:
        """Ask for a prediction; see `PredictorProcess.ask`."""
        return super().ask(view, min(patience, self._deadline) if self.is_warm else patience)


def make_predictor(name: str, deadline: float) -> PromptPredictor | None:
    """Return the predictor of a name; None for "none".

    Raises:
        BadPredictionError: if it cannot be made.
    """
    return None if name == "none" else PromptPredictor(name, deadline)
