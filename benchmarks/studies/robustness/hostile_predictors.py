"""Hostile predictors: they predict falsely, write into their arguments, answer late, or raise.

None of them may make a car collide at a reliance below 1 and a level of 0, or crash the program.
"""

from __future__ import annotations

import ctypes
import dataclasses
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import Grid
from foresee.prediction import Prediction, View

DEADLINE = 0.05
"""Deadline of predictions in these drives, which late predictors miss [s]."""

Answer = Callable[[Grid, NDArray[np.float64], int], Any]
"""Function from observed map, pose and number of the call to an answer."""


@dataclasses.dataclass
class Hostile:
    """A predictor that answers by a function, which also gets the number of the call."""

    answer: Answer
    calls: int = 0

    def predict(self, view: View) -> Any:
        """Return or raise whatever the function does."""
        self.calls += 1
        return self.answer(view.known, view.pose, self.calls)


def claim(known: Grid, free: Any, confidence: float = 1.0, dtype: Any = np.float32) -> Prediction:
    """Return a prediction for all cells: free with a probability, and else occupied.

    Args:
        known: observed map.
        free: probability of free, one for all cells or one for each.
        confidence: confidence of all cells.
        dtype: type of the arrays.
    """
    p_free = np.broadcast_to(np.asarray(free, dtype), known.frame.shape).copy()
    return Prediction(
        known.frame,
        p_free,
        (1 - p_free).astype(dtype),
        np.full(known.frame.shape, confidence, dtype),
    )


def claiming(free: Any, confidence: float = 1.0, dtype: Any = np.float32) -> Answer:
    """Return a function that always answers with the same `claim`."""
    return lambda known, pose, call: claim(known, free, confidence, dtype)


def noise(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Claim random probabilities, other ones at each call."""
    return claim(known, np.random.default_rng(call).random(known.frame.shape))


def ahead(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Claim that all is free ahead of the car and occupied behind it, so that it drives fast."""
    x, y = known.frame.centres()
    before = np.cos(pose[2]) * (x - pose[0]) + np.sin(pose[2]) * (y[:, None] - pose[1]) > 0
    return claim(known, before)


def overwriting(cell: int) -> Answer:
    """Return a function that overwrites all cells of the given map, and claims confidence 0.5."""

    def answer(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
        known.cells.setflags(write=True)
        known.cells[:] = cell
        return claim(known, 1.0, 0.5)

    return answer


def moves_the_car(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Change the pose that is given."""
    pose += 3.0
    return claim(known, 1.0)


def moves_the_map(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Change the frame of the given map, although it is frozen."""
    answer = dataclasses.replace(claim(known, 1.0), frame=dataclasses.replace(known.frame))
    object.__setattr__(known.frame, "origin", (0.0, 0.0))
    object.__setattr__(known.frame, "resolution", 1.0)
    return answer


def writes_later(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Claim a confidence of 0, and raise it from a thread after the answer was checked."""
    answer = claim(known, 1.0, 0.0)
    known.cells.setflags(write=True)

    def go_on() -> None:
        for _ in range(20):
            time.sleep(0.002)
            known.cells[:] = 0
            pose[:] = 0.0
            answer.p_free[:] = 1.0
            answer.confidence[:] = 7.0

    threading.Thread(target=go_on, daemon=True).start()
    return answer


def late(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Give every third answer after the deadline."""
    if call % 3 == 0:
        time.sleep(3 * DEADLINE)
    return claim(known, 1.0)


def holds_the_lock(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Let no other thread run before every third answer, as compiled code may."""
    if call % 3 == 0:
        ctypes.PyDLL(None).usleep(int(3e6 * DEADLINE))
    return claim(known, 1.0)


class _Lasting(np.ndarray):
    """An array that takes longer than the deadline to be destroyed."""

    def __del__(self) -> None:
        time.sleep(3 * DEADLINE)


def never(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
    """Never return from the third call on."""
    if call > 2:
        threading.Event().wait()
    return claim(known, 1.0)


def raising(error: type[BaseException]) -> Answer:
    """Return a function that raises an error after three valid answers."""

    def answer(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
        if call > 3:
            raise error
        return claim(known, 1.0)

    return answer


class _UnprintableError(Exception):
    def __str__(self) -> str:
        raise RuntimeError("not even this")


class _Lazy(Prediction):
    """A prediction whose fields raise when they are read."""

    def __getattribute__(self, name: str) -> Any:
        raise SystemExit(name)


class _Array(np.ndarray):
    """An array whose comparisons and extrema pretend that all values are valid."""

    def __array_ufunc__(self, *args: Any, **kwargs: Any) -> Any:
        return np.True_

    def min(self, *args: Any, **kwargs: Any) -> Any:
        return 0.0

    max = min


def broken(**fields: Any) -> Answer:
    """Return a function that replaces some fields of a valid prediction.

    Args:
        fields: new value of each field, or a function from the valid value to the new one.
    """

    def answer(known: Grid, pose: NDArray[np.float64], call: int) -> Prediction:
        good = claim(known, 1.0)
        new = {k: v(getattr(good, k)) if callable(v) else v for k, v in fields.items()}
        return dataclasses.replace(good, **new)

    return answer


LIARS: dict[str, Answer] = {
    **{
        f"free, confidence {confidence!r}": claiming(1, confidence)
        for confidence in (0.5, 0.9, 0.99, 0.999, 0.999999, 1 - 1e-7, 1.0)
    },
    "free, confidence 1 - 1e-9 (double)": claiming(1, 1 - 1e-9, np.float64),
    "free, confidence 0.9999 (half)": claiming(1, 0.9999, np.float16),
    "free, confidence True (bool)": claiming(1, True, np.bool_),
    "occupied": claiming(0),
    "free, then occupied": lambda known, pose, call: claim(known, call % 2),
    "noise": noise,
    "free ahead": ahead,
    "NaN in half of the cells": broken(
        confidence=lambda c: np.where(np.arange(c.size).reshape(c.shape) % 2, np.nan, c)
    ),
    "hidden in an array of its own": broken(
        confidence=lambda c: (c * np.float32(0.99)).view(_Array)
    ),
}
"""Predictors that keep to the contract, but predict falsely."""
WRITERS: dict[str, Answer] = {
    "clears the map": overwriting(0),
    "fills the map": overwriting(100),
    "moves the car": moves_the_car,
    "moves the map": moves_the_map,
    "writes later": writes_later,
}
"""Predictors that write into their arguments."""
LATE: dict[str, Answer] = {
    "late": late,
    "never": never,
    "holds the interpreter's lock": holds_the_lock,
    "takes long to be destroyed": broken(confidence=lambda c: c.view(_Lasting)),
}
"""Predictors that do not keep the deadline."""
RAISING: dict[str, Answer] = {
    **{
        f"raises {error.__name__}": raising(error)
        for error in (
            RuntimeError,
            MemoryError,
            RecursionError,
            StopIteration,
            GeneratorExit,
            KeyboardInterrupt,
            SystemExit,
            BaseException,
            TimeoutError,
        )
    },
    "raises what cannot be shown": raising(_UnprintableError),
}
"""Predictors that raise exceptions."""
INVALID: dict[str, Answer] = {
    "None": lambda known, pose, call: None,
    "text": lambda known, pose, call: "free everywhere",
    "a dictionary": lambda known, pose, call: {"p_free": 1.0},
    "fields that raise": lambda known, pose, call: object.__new__(_Lazy),
    "infinite": broken(confidence=lambda c: c * np.inf),
    "above one": broken(confidence=lambda c: c + np.float32(1.0)),
    "negative": broken(p_free=lambda p: p - np.float32(2.0)),
    "sum above one": broken(p_occupied=lambda p: p + np.float32(1.0)),
    "complex": broken(confidence=lambda c: c.astype(np.complex64)),
    "objects": broken(confidence=lambda c: c.astype(object)),
    "too small": broken(p_free=lambda p: p[:-1]),
    "no dimension": broken(p_free=1.0),
    "no field": broken(p_free=None),
    "another place": broken(
        frame=lambda frame: dataclasses.replace(frame, origin=(frame.origin[0] + 0.02, 0.0))
    ),
    "no frame": broken(frame=None),
}
"""Predictors that break the contract of answers."""
FAULTY = LATE | RAISING | INVALID
"""Predictors whose faults must be counted."""
CLASSES = {
    "false predictions: all free, all occupied, noise": LIARS,
    "write to their inputs, also after they have returned": WRITERS,
    "answer too late or never": LATE,
    "raise exceptions": RAISING,
    "return invalid values: NaN, wrong types, shapes, sums": INVALID,
}
"""Description of each class of predictors → its predictors."""
KINDS = LIARS | WRITERS | FAULTY
"""Name of each hostile predictor → its answers."""


def hostile(kind: str) -> Hostile:
    """Return the hostile predictor of a kind, as a `PredictorProcess` makes it."""
    return Hostile(KINDS[kind])
