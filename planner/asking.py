"""Asking a predictor, whatever it does: the plug-in may raise, answer late, or never."""

from __future__ import annotations

import queue
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor import BadPredictionError, Grid, Prediction, Predictor, checked


class LateError(Exception):
    """The answer is not there in time, or an earlier question is still being answered."""


class RaisedError(Exception):
    """The predictor raised."""


class Asker:
    """Puts one question at a time to a predictor, in a thread that cannot hold the program up.

    A daemon thread and not a pool: a pool waits for its threads when the program ends, and one
    that hangs would keep it from ending.

    Args:
        predictor: asked.
    """

    def __init__(self, predictor: Predictor) -> None:
        self.predictor = predictor
        self._thread: threading.Thread | None = None

    def ask(self, known: Grid, pose: NDArray[np.float64], patience: float) -> Prediction:
        """The checked answer.

        Args:
            known: what has been seen.
            pose: x, y, yaw, (3,).
            patience: how long to wait for it [s].

        Raises:
            LateError: if it is not there in time.
            RaisedError: if the predictor raised, anything at all.
            BadPredictionError: if the answer breaks the contract.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LateError
        answers: queue.SimpleQueue[tuple[Any, BaseException | None]] = queue.SimpleQueue()

        def work() -> None:
            try:
                answers.put((self.predictor.predict(known, pose), None))
            except BaseException as error:
                answers.put((None, error))

        self._thread = threading.Thread(target=work, name="predictor", daemon=True)
        self._thread.start()
        try:
            answer, error = answers.get(timeout=patience)
        except queue.Empty:
            raise LateError from None
        # It has nothing left to do, but on a busy machine it may still seem to when asked next.
        self._thread.join()
        if error is not None:
            raise RaisedError from error
        try:
            return checked(answer, known)
        except BadPredictionError:
            raise
        except Exception as odd:
            # An answer can be wrong in ways that no check foresees.
            raise BadPredictionError(str(odd)) from odd
