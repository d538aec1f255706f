"""Calls of a predictor, in a thread: a plug-in may raise, answer late, or never answer."""

from __future__ import annotations

import queue
import threading

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import Grid
from foresee.prediction import (
    BadPredictionError,
    Prediction,
    Predictor,
    checked,
    context_side,
    copied,
)


class LateError(Exception):
    """The prediction is late, or the predictor still works on an earlier one."""


class RaisedError(Exception):
    """The predictor raised an exception; it is the `__cause__`."""


class Asker:
    """Calls a predictor in a thread, one call at a time, and stops waiting after a deadline.

    It uses a daemon thread, not a pool: a pool waits for its threads when the program ends, so a
    call that hangs would keep the program from ending.

    Args:
        predictor: predictor to call.

    Attributes:
        context_side: side of the larger square whose observed map the predictor also gets [m];
            0: it gets none.

    Raises:
        BadPredictionError: if the predictor's `context_side` is not a length.
    """

    def __init__(self, predictor: Predictor) -> None:
        self.predictor = predictor
        self.context_side = context_side(predictor)
        self._thread: threading.Thread | None = None

    def ask(
        self,
        known: Grid,
        pose: NDArray[np.float64],
        patience: float,
        around: Grid | None = None,
    ) -> Prediction:
        """Ask for a prediction, and check it.

        Args:
            known: observed map of the square to predict.
            pose: x, y, yaw of the car, (3,) [m, m, rad].
            patience: time to wait for the prediction [s].
            around: observed map of the square of `context_side`; None if that is 0.

        Raises:
            LateError: if there is no prediction after `patience`, or an earlier call still runs.
            RaisedError: if the predictor raised any exception, even SystemExit.
            BadPredictionError: if the answer breaks the contract of predictors.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LateError
        # Copies, since a plug-in may write into its arguments, even later from its own thread.
        copies = copied(known, pose, around)
        answers: queue.SimpleQueue[Prediction | RaisedError | BadPredictionError]
        answers = queue.SimpleQueue()

        def work() -> None:
            try:
                answer = self.predictor.predict(*copies)
            except BaseException as error:
                raised = RaisedError()
                raised.__cause__ = error
                answers.put(raised)
                return
            try:
                # Checked in this thread, since reading a field may run code of the plug-in.
                answers.put(checked(answer, known))
            except BadPredictionError as error:
                answers.put(error)
            except BaseException as odd:
                answers.put(BadPredictionError(f"to read it raised {type(odd).__name__}"))

        self._thread = threading.Thread(target=work, name="predictor", daemon=True)
        self._thread.start()
        try:
            found = answers.get(timeout=patience)
        except queue.Empty:
            raise LateError from None
        # The thread is about to end; without this, the next call might still find it alive.
        self._thread.join()
        if isinstance(found, Exception):
            raise found
        return found
