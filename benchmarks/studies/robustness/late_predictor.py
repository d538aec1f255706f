"""A predictor whose answers come some ticks late, the same ones on every machine."""

from __future__ import annotations

from foresee.prediction import Prediction, Predictor, View
from planner.risk.ask_predictor import Asker, LateError


class LateAsker(Asker):
    """Calls a predictor, and hands each answer out a number of ticks after its question.

    It stands for a predictor that takes this long on a robot, and gets the next question only then.

    Args:
        predictor: predictor to call.
        ticks: number of ticks that it takes; 0: it answers in the tick of the question.
    """

    def __init__(self, predictor: Predictor, ticks: int) -> None:
        super().__init__(predictor)
        self._ticks = ticks
        self._coming: Prediction | None = None
        self._left = 0

    def take_late(self) -> Prediction | None:
        """Return the answer to an earlier question in the tick in which it is there, else None."""
        self._left -= 1
        if self._left > 0:
            return None
        answer, self._coming = self._coming, None
        return answer

    def ask(self, view: View, patience: float) -> Prediction:
        """Ask for a prediction, see `Asker.ask`.

        Raises:
            LateError: if the answer takes ticks, or an earlier one is still to come.
        """
        if self._coming is None:
            answer = super().ask(view, patience)
            if self._ticks == 0:
                return answer
            self._coming, self._left = answer, self._ticks
        raise LateError
