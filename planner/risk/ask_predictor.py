"""Calls of a predictor, in a thread: a plug-in may raise, answer late, or never answer."""

from __future__ import annotations

import queue
import threading
import time

from foresee.prediction import BadPredictionError, Caller, Prediction, Predictor, RaisedError, View

FIRST_DEADLINE = 180.0
"""Longest wait for the first prediction, for which code may have to be loaded and compiled [s]."""


class LateError(Exception):
    """The prediction is late, or the predictor still works on an earlier one.

    Its answer is not lost: the asker's `take_late` returns it once it is there.
    """


class Asker:
    """Calls a predictor in a thread, one call at a time, and stops waiting after a deadline.

    It uses a daemon thread, not a pool: a pool waits for its threads when the program ends, so a
    call that hangs would keep the program from ending.

    What a predictor makes is also destroyed in its thread, since a `__del__` may take any time. Two
    things can still delay the caller: compiled code that does not release the interpreter's lock,
    and reference cycles with a `__del__`, which Python collects in any thread. A
    `planner.risk.predictor_process.PredictorProcess` can do neither.

    Args:
        predictor: predictor to call.

    Attributes:
        context_side: side of the larger square that the predictor wants to see [m]; 0: none.
        side: side of the square that it predicts [m]; 0: it states none.

    Raises:
        BadPredictionError: if it cannot be called as a predictor.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._caller = Caller(predictor)
        self.context_side, self.side = self._caller.context_side, self._caller.side
        self._thread: threading.Thread | None = None
        self._answers = queue.SimpleQueue[Prediction | BadPredictionError]()

    def take_late(self) -> Prediction | None:
        """Return the answer to an earlier question that was late, once; None if there is none.

        If it was an error, nothing is returned.
        """
        try:
            answer = self._answers.get_nowait()
        except queue.Empty:
            return None
        return answer if isinstance(answer, Prediction) else None

    def ask(self, view: View, patience: float) -> Prediction:
        """Ask for a prediction, and check it.

        Args:
            view: what was observed; the predictor gets a copy, since it may write into it.
            patience: time to wait for the prediction [s].

        Raises:
            LateError: if there is no prediction after `patience`, or an earlier call still runs.
            RaisedError: if the predictor raised any exception, even SystemExit.
            BadPredictionError: if the answer breaks the contract of predictors.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LateError
        deadline = time.monotonic() + patience
        # A new one, so that no answer that nobody has taken counts as this one's.
        answers = self._answers = queue.SimpleQueue[Prediction | BadPredictionError]()
        self._thread = threading.Thread(
            target=lambda: answers.put(self._answer(view)), name="predictor", daemon=True
        )
        self._thread.start()
        try:
            answer = answers.get(timeout=patience)
        except queue.Empty:
            raise LateError from None
        # The thread is about to end; without this, the next call might still find it alive.
        self._thread.join(max(0.0, deadline - time.monotonic()))
        if isinstance(answer, BadPredictionError):
            raise answer
        return answer

    def _answer(self, view: View) -> Prediction | BadPredictionError:
        """Return the predictor's answer, checked, or the error; it runs in the thread.

        The error is a new one: the traceback of the predictor's own error refers to its objects,
        which would then be destroyed by the caller.
        """
        try:
            return self._caller.ask(view)
        except RaisedError as error:
            return RaisedError(str(error))
        except BadPredictionError as error:
            return BadPredictionError(str(error))
        except BaseException as error:
            return RaisedError(f"the predictor raised {type(error).__name__}")
