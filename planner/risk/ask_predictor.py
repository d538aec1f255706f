"""Calls of a predictor, in a thread: a plug-in may raise, answer late, or never answer."""

from __future__ import annotations

import queue
import threading
from copy import deepcopy

from foresee.prediction import BadPredictionError, Caller, Prediction, Predictor, RaisedError, View


class LateError(Exception):
    """The prediction is late, or the predictor still works on an earlier one."""


class Asker:
    """Calls a predictor in a thread, one call at a time, and stops waiting after a deadline.

    It uses a daemon thread, not a pool: a pool waits for its threads when the program ends, so a
    call that hangs would keep the program from ending.

    Args:
        predictor: predictor to call.

    Attributes:
        context_side: side of the larger square that the predictor wants to see [m]; 0: none.

    Raises:
        BadPredictionError: if it cannot be called as a predictor.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._caller = Caller(predictor)
        self.context_side = self._caller.context_side
        self._thread: threading.Thread | None = None

    def ask(self, view: View, patience: float) -> Prediction:
        """Ask for a prediction, and check it.

        Args:
            view: what was observed.
            patience: time to wait for the prediction [s].

        Raises:
            LateError: if there is no prediction after `patience`, or an earlier call still runs.
            RaisedError: if the predictor raised any exception, even SystemExit.
            BadPredictionError: if the answer breaks the contract of predictors.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LateError
        # A copy, since a plug-in may write into its arguments, even later from its own thread.
        given = deepcopy(view)
        answers: queue.SimpleQueue[Prediction | BadPredictionError] = queue.SimpleQueue()

        def work() -> None:
            # The answer is checked in this thread, since reading it may run code of the plug-in.
            try:
                answers.put(self._caller.ask(view, given))
            except BadPredictionError as error:
                answers.put(error)
            except BaseException as error:
                raised = RaisedError(f"the predictor raised {type(error).__name__}")
                raised.__cause__ = error
                answers.put(raised)

        self._thread = threading.Thread(target=work, name="predictor", daemon=True)
        self._thread.start()
        try:
            answer = answers.get(timeout=patience)
        except queue.Empty:
            raise LateError from None
        # The thread is about to end; without this, the next call might still find it alive.
        self._thread.join()
        if isinstance(answer, BadPredictionError):
            raise answer
        return answer
