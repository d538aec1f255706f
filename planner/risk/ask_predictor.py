"""Asking a predictor safely: a plug-in may raise, answer late, or never answer."""

from __future__ import annotations

import queue
import threading

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.grid import Grid
from predictor.prediction import (
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
    """The predictor raised."""


class Asker:
    """Puts one question at a time to a predictor, in a thread that cannot hold the program up.

    A daemon thread and not a pool: a pool waits for its threads when the program ends, and one
    that hangs would keep it from ending.

    Args:
        predictor: asked.

    Attributes:
        context_side: side of the square that the predictor is told of besides its own [m]; 0: none.

    Raises:
        BadPredictionError: if the predictor's `context_side` is no length.
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
            known: what has been seen.
            pose: x, y, yaw, (3,).
            patience: how long to wait for it [s].
            around: what has been seen of the square of `context_side`; None if there is none.

        Raises:
            LateError: if it is not there in time.
            RaisedError: if the predictor raised, anything at all.
            BadPredictionError: if the answer breaks the contract.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LateError
        # Copies: a plug-in may write into what it is handed, also later, from a thread of its own.
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
                # Here too: to read a field of the answer may run the plug-in's code.
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
        # It has nothing left to do, but on a busy machine it may still seem to when asked next.
        self._thread.join()
        if isinstance(found, Exception):
            raise found
        return found
