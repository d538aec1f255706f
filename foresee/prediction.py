"""The contract between a predictor and everything that uses one."""

from __future__ import annotations

import inspect
import math
import numbers
import warnings
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.mapping.context import SIDE
from foresee.mapping.grid import Grid, GridFrame, OccupancyGrid


@dataclass(frozen=True, eq=False)
class Prediction:
    """Probabilities that a predictor gives to the cells of a map.

    The rest, 1 - p_free - p_occupied, is the probability that the cell can never be observed, such
    as inside a wall.

    Attributes:
        frame: position and resolution of the cells.
        p_free: probability that a cell is free, (rows, columns).
        p_occupied: probability that a cell is a surface that a ray can hit, (rows, columns).
        confidence: how far the two probabilities may be relied upon, in [0, 1], (rows, columns);
            0 means unknown.
        nan_cells: number of unobserved cells that were NaN and were made unknown by `checked`.
        doubt: factor of at least 1. In the present surroundings, the probability that a prediction
            is wrong is this many times as high as p_free and the confidence say. The level of the
            last resort is divided by it.
    """

    frame: GridFrame
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    confidence: NDArray[np.float32]
    nan_cells: int = 0
    doubt: float = 1.0


@dataclass(frozen=True, eq=False)
class View:
    """What a predictor is shown of the observed map.

    Attributes:
        known: map of all that was observed inside the square to predict, which is centred on the
            robot. Its side is the predictor's `side`; a predictor without one is asked for a square
            that is at most `expansion` times as wide as the LIDAR's window.
        pose: x, y, yaw of the robot, (3,) [m, m, rad].
        around: map of all that was observed inside a larger square around the robot. Its side is
            the predictor's `context_side`. Where no larger map exists, it is `known` itself, as for
            the frames of the paper's study.

    Raises:
        ValueError: if there is no cell to predict, or the pose is not finite.
    """

    known: Grid
    pose: NDArray[np.float64]
    around: Grid = None  # type: ignore[assignment]  # replaced by `known` below

    def __post_init__(self) -> None:
        if self.known.cells.size == 0:
            raise ValueError("the window is empty: there is no cell to predict")
        if not np.isfinite(self.pose).all():
            raise ValueError(f"pose is {self.pose}, it must be finite")
        if self.around is None:
            object.__setattr__(self, "around", self.known)

    @classmethod
    def of(
        cls,
        observed: Grid | OccupancyGrid,
        pose: NDArray[np.float64],
        side: float,
        context_side: float,
    ) -> View:
        """Return the view of a robot in a map.

        Args:
            observed: map of all that was observed.
            pose: x, y, yaw of the robot, (3,) [m, m, rad].
            side: side of the square to predict [m].
            context_side: side of the square of `around` [m]; 0: no larger map is wanted.
        """
        x, y, frame = float(pose[0]), float(pose[1]), observed.frame
        known = observed.crop(frame.square(x, y, side))
        around = observed.crop(frame.square(x, y, context_side)) if context_side else known
        return cls(known, pose, around)


@runtime_checkable
class Predictor(Protocol):
    """Anything that predicts the unobserved part of a map: the interface of a plug-in.

    A predictor may have an attribute `context_side`: the side of the square of `View.around` [m],
    at most `LARGEST_CONTEXT`. Without it, the side is 40 m, which takes 0.1 ms in each tick. If it
    is 0, `around` is `known`. An attribute `side` states the side of the square that it predicts
    [m], at most `LARGEST_CONTEXT` as well: routes use predictions as far as they reach.
    """

    def predict(self, view: View) -> Prediction:
        """Predict the unobserved cells of a map.

        The same view must give the same prediction, so a predictor keeps no state. It must not
        write into the view. The car waits for the prediction, at most for
        `NavigatorConfig.deadline`; the control period is 0.1 s.

        Args:
            view: what was observed, and the pose of the robot.

        Returns:
            A prediction on the frame of `view.known`. Its values lie in [0, 1], and
            p_free + p_occupied is at most 1. NaN means unknown. `doubt` may be left out.
        """
        ...


LARGEST_CONTEXT = 100.0
"""Largest `context_side` and `side` that a predictor may have [m]."""


class BadPredictionError(LineError):
    """A predictor raised, or its answer breaks the contract; the message is one line."""


class RaisedError(BadPredictionError):
    """A predictor raised an exception, which is the `__cause__`."""


def with_observed(
    known: Grid,
    p_free: NDArray[np.float32],
    p_occupied: NDArray[np.float32],
    confidence: NDArray[np.float32],
    nan_cells: int = 0,
    doubt: float = 1.0,
) -> Prediction:
    """Return a prediction in which observed cells keep their observed value, at confidence 1.

    Args:
        known: map of all that was observed.
        p_free: probability of free, (rows, columns); counts in unobserved cells only.
        p_occupied: probability of occupied, likewise.
        confidence: confidence, likewise.
        nan_cells: number of unobserved cells that were NaN.
        doubt: see `Prediction`.
    """
    observed = known.free, known.occupied, ~known.unknown
    p_free, p_occupied, confidence = (
        np.where(known.unknown, *pair).astype(np.float32, copy=False)
        for pair in zip((p_free, p_occupied, confidence), observed, strict=True)
    )
    return Prediction(known.frame, p_free, p_occupied, confidence, nan_cells, doubt)


def checked(prediction: Prediction, known: Grid) -> Prediction:
    """Check a predictor's answer, and set observed cells to what was observed.

    A cell with a NaN in a probability or in the confidence becomes unknown, and is counted.

    Args:
        prediction: answer of the predictor.
        known: map that it was asked about.

    Raises:
        BadPredictionError: if it is not a Prediction, lies elsewhere than asked, has the wrong
            shape, or holds values outside [0, 1] or a doubt below 1.
    """
    if not isinstance(prediction, Prediction):
        raise BadPredictionError(
            f"predict() returned {type(prediction).__name__}, it must return a Prediction"
        )
    if prediction.frame != known.frame:
        raise BadPredictionError(f"prediction lies on {prediction.frame}, asked: {known.frame}")
    shape = known.frame.shape
    fields = {}
    for name in ("p_free", "p_occupied", "confidence"):
        # A copy, since a plug-in may still write into its own arrays.
        values = np.array(getattr(prediction, name))
        if values.shape != shape or values.dtype.kind not in "fiub":
            raise BadPredictionError(
                f"{name} is {values.dtype} {values.shape}, it must be real numbers {shape}"
            )
        if not _lies_within(values, 0.0, 1.0):
            raise BadPredictionError(f"{name} has values outside [0, 1]")
        fields[name] = values.astype(np.float32, copy=False)
    doubt = _doubt(prediction.doubt)
    sum_ = fields["p_free"] + fields["p_occupied"]
    if not _lies_within(sum_, 0.0, 1.0 + 1e-4):
        raise BadPredictionError("p_free + p_occupied exceeds 1 in some cells")
    sum_ += fields["confidence"]
    nan_cells = 0
    if np.isnan(sum_.max(initial=0.0)):
        unusable = np.isnan(sum_)
        nan_cells = int((unusable & known.unknown).sum())
        fields = {name: np.where(unusable, 0.0, values) for name, values in fields.items()}
    p_free, p_occupied, confidence = fields.values()
    return with_observed(known, p_free, p_occupied, confidence, nan_cells, doubt)


def _doubt(given: Any) -> float:
    """Return a predictor's doubt, which may be of any kind of number."""
    try:
        # Converted once, since a plug-in's number may change from one reading to the next.
        doubt = float(given) if isinstance(given, numbers.Real) else math.nan
    except OverflowError:
        doubt = math.inf
    # A comparison with NaN is false.
    if not 1.0 <= doubt < math.inf:
        raise BadPredictionError(
            f"doubt is {given!r:.40}, it must be a finite number of at least 1"
        )
    return doubt


_WARNED = WeakSet[type]()
"""Classes of predictors of the old form, of which the user was warned."""


class Caller:
    """Calls a predictor, of which nothing is assumed, and checks its answers.

    Until version 2, `predict` may also have the form that it had before there was a `View`:
    `predict(known, pose)`, or `predict(known, pose, around)` with a `context_side`. Nothing but
    this class knows of it.

    Args:
        predictor: predictor to call.

    Raises:
        BadPredictionError: if the predictor has no method `predict(view)`, or its `context_side` or
            `side` is not a length from 0 to `LARGEST_CONTEXT`.

    Attributes:
        name: name of the predictor's class.
        context_side: side of the square of `View.around` [m]; 0: no larger map is wanted.
        side: side of the square that it predicts [m]; 0: it states none.
        is_old: whether `predict` has the old form.
    """

    def __init__(self, predictor: Predictor) -> None:
        kind = type(predictor)
        self.name = kind.__name__
        self._predict: Callable[..., Any] = _read(predictor, "predict", None)
        if not callable(self._predict):
            raise BadPredictionError(f"{self.name} has no method predict(view) -> Prediction")
        signature = _signature(self._predict)
        self.is_old = "pose" in signature.parameters or not _takes(signature, 1)
        self.context_side = _length(predictor, "context_side", 0.0 if self.is_old else SIDE)
        self.side = _length(predictor, "side", 0.0)
        if self.is_old:
            if not _takes(signature, 3 if self.context_side else 2):
                raise BadPredictionError(
                    f"{self.name} has predict{signature}, it must be predict(view) -> Prediction"
                )
            _warn(kind)

    def predict(self, view: View) -> Any:
        """Call the predictor, and return or raise whatever it does."""
        if not self.is_old:
            return self._predict(view)
        larger = (view.around,) if self.context_side and view.around is not view.known else ()
        return self._predict(view.known, view.pose, *larger)

    def ask(self, view: View, given: View | None = None) -> Prediction:
        """Call the predictor in this thread, and check its answer.

        Args:
            view: what was observed; the predictor does not get hold of it.
            given: deep copy of `view`, which the predictor gets and may change; None: it is made
                here.

        Raises:
            RaisedError: if the predictor raises an exception.
            BadPredictionError: if its answer breaks the contract.
        """
        given = deepcopy(view) if given is None else given
        try:
            answer = self.predict(given)
        except (Exception, SystemExit) as error:
            raise RaisedError(f"predict() of {self.name} raised {one_line(error)}") from error
        try:
            return checked(answer, view.known)
        except BadPredictionError:
            raise
        except (Exception, SystemExit) as error:
            # To read a field may run code of the plug-in.
            raise BadPredictionError(
                f"the answer of {self.name} raised {one_line(error)} when it was read"
            ) from error


def _read(predictor: Any, name: str, default: Any) -> Any:
    """Return an attribute of a predictor."""
    try:
        return getattr(predictor, name, default)
    except (Exception, SystemExit) as error:
        raise BadPredictionError(f"{name} raised {one_line(error)}") from error


def _length(predictor: Any, name: str, default: float) -> float:
    """Return an attribute of a predictor that is a length [m]."""
    length = _read(predictor, name, default)
    if not isinstance(length, int | float) or not 0.0 <= length <= LARGEST_CONTEXT:
        raise BadPredictionError(
            f"{name} is {length!r}, it must be a length from 0 to {LARGEST_CONTEXT:g} m"
        )
    return float(length)


def _signature(predict: Callable[..., Any]) -> inspect.Signature:
    """Return the signature of a method; that of `predict(view)` if it cannot be read."""
    try:
        return inspect.signature(predict)
    except (TypeError, ValueError):  # Compiled code may have none.
        return inspect.signature(lambda view: None)


def _takes(signature: inspect.Signature, count: int) -> bool:
    """Return whether a call with a number of arguments fits a signature."""
    try:
        signature.bind(*(None,) * count)
    except TypeError:
        return False
    return True


def _warn(kind: type) -> None:
    """Warn, once for each class, that the old form of `predict` is deprecated."""
    if kind not in _WARNED:
        _WARNED.add(kind)
        warnings.warn(
            f"{kind.__module__}.{kind.__qualname__} has predict(known, pose): from version 2 on, "
            "it must be predict(view), where view.known and view.pose are the same",
            DeprecationWarning,
            stacklevel=3,
        )


def _lies_within(values: NDArray[Any], low: float, high: float) -> bool:
    """Return whether no value lies outside of [low, high]; NaN counts as inside."""
    ends = values.min(initial=low), values.max(initial=low)
    if np.isnan(ends).any():
        return not ((values < low) | (values > high)).any()
    return bool(low <= ends[0] and ends[1] <= high)
