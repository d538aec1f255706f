"""The newest answer of a predictor, which may fail or be late."""

from __future__ import annotations

from foresee.prediction import BadPredictionError, Prediction, RaisedError, View
from planner.fault import Fault
from planner.risk.ask_predictor import Asker, LateError
from planner.risk.predictor_process import PredictorProcess


class NewestPrediction:
    """Asks a predictor in each tick, and says what counts.

    While an answer is late, the newest one before it counts: cells that were observed since are not
    believed any more, and what it says of the others is still the best that is known.

    Args:
        asker: asks the predictor.
    """

    def __init__(self, asker: Asker | PredictorProcess) -> None:
        self.asker = asker
        self._newest: Prediction | None = None
        self._is_owed = False
        """Whether the answer to an earlier question was late."""

    def ask(self, view: View, patience: float) -> tuple[Prediction | None, tuple[Fault, ...]]:
        """Return the newest answer, or None if the predictor fails, and the faults.

        Args:
            view: what was observed.
            patience: time to wait for the answer [s].
        """
        prediction, faults = None, tuple[Fault, ...]()
        # An answer that another caller has waited for is about another place.
        late = self.asker.take_late() if self._is_owed else None
        try:
            prediction = self.asker.ask(view, patience)
            self._is_owed = False
            if prediction.nan_cells:
                faults = (Fault.PREDICTOR_NAN,)
        except LateError:
            prediction, faults = late or self._newest, (Fault.PREDICTOR_LATE,)
            self._is_owed = True
        except RaisedError:
            faults = (Fault.PREDICTOR_RAISED,)
        except BadPredictionError:
            faults = (Fault.PREDICTOR_BAD,)
        self._newest = prediction
        return prediction, faults
