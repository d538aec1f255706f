"""The contract between a predictor and everything that uses one."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.mapping.grid import Grid, GridFrame


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
    """

    frame: GridFrame
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    confidence: NDArray[np.float32]
    nan_cells: int = 0


@runtime_checkable
class Predictor(Protocol):
    """Anything that predicts the unobserved part of a map: the interface of a plug-in.

    A predictor that wants to see more of the map than the square that it predicts has an attribute
    `context_side`, the side of a larger square around the robot [m], at most `LARGEST_CONTEXT`.
    Its method is then called as `predict(known, pose, around)`, where `around` is the map of all
    that was observed in that square. Where no larger map exists, as for the frames of the paper's
    study, it is called as `predict(known, pose)`: `around` should have the default None.
    """

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Predict the unobserved cells of a map.

        The same arguments must give the same prediction, so a predictor keeps no state. It must not
        write into its arguments. The car waits for the prediction, at most for
        `NavigatorConfig.deadline`; the control period is 0.1 s.

        Args:
            known: map of all that was observed inside the predicted square, which is at most
                `expansion` times as wide as the LIDAR's window and centred on the robot.
            pose: x, y, yaw of the robot, (3,) [m, m, rad].

        Returns:
            A prediction on the frame of `known`. Its values lie in [0, 1], and p_free + p_occupied
            is at most 1. NaN means unknown.
        """
        ...


LARGEST_CONTEXT = 100.0
"""Largest `context_side` that a predictor may have [m]."""


class BadPredictionError(LineError):
    """A predictor raised, or its answer breaks the contract; the message is one line."""


def with_observed(
    known: Grid,
    p_free: NDArray[np.float32],
    p_occupied: NDArray[np.float32],
    confidence: NDArray[np.float32],
    nan_cells: int = 0,
) -> Prediction:
    """Return a prediction in which observed cells keep their observed value, at confidence 1.

    Args:
        known: map of all that was observed.
        p_free: probability of free, (rows, columns); counts in unobserved cells only.
        p_occupied: probability of occupied, likewise.
        confidence: confidence, likewise.
        nan_cells: number of unobserved cells that were NaN.
    """
    observed = known.free, known.occupied, ~known.unknown
    p_free, p_occupied, confidence = (
        np.where(known.unknown, *pair).astype(np.float32, copy=False)
        for pair in zip((p_free, p_occupied, confidence), observed, strict=True)
    )
    return Prediction(known.frame, p_free, p_occupied, confidence, nan_cells)


def check_question(known: Grid, pose: NDArray[np.float64]) -> None:
    """Check the arguments of `predict`.

    Raises:
        ValueError: if the map is empty or the pose not finite.
    """
    if known.cells.size == 0:
        raise ValueError("the window is empty: there is no cell to predict")
    if not np.isfinite(pose).all():
        raise ValueError(f"pose is {pose}, it must be finite")


def checked(prediction: Prediction, known: Grid) -> Prediction:
    """Check a predictor's answer, and set observed cells to what was observed.

    A cell with a NaN in a probability or in the confidence becomes unknown, and is counted.

    Args:
        prediction: answer of the predictor.
        known: map that it was asked about.

    Raises:
        BadPredictionError: if it is not a Prediction, lies elsewhere than asked, has the wrong
            shape, or holds values outside [0, 1].
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
    return with_observed(known, p_free, p_occupied, confidence, nan_cells)


def context_side(predictor: Predictor) -> float:
    """Return the side of the larger square whose map a predictor asks for [m]; 0: it asks for none.

    Raises:
        BadPredictionError: if its `context_side` is not a length from 0 to `LARGEST_CONTEXT`.
    """
    try:
        side = getattr(predictor, "context_side", 0.0)
    except (Exception, SystemExit) as error:
        raise BadPredictionError(f"context_side raised {one_line(error)}") from error
    if not isinstance(side, int | float) or not 0.0 <= side <= LARGEST_CONTEXT:
        raise BadPredictionError(
            f"context_side is {side!r}, it must be a length from 0 to {LARGEST_CONTEXT:g} m"
        )
    return float(side)


def asked(
    predictor: Predictor,
    known: Grid,
    pose: NDArray[np.float64],
    around: Grid | None = None,
    copies: tuple[Any, ...] | None = None,
) -> Prediction:
    """Call a predictor in this thread, and check its answer.

    Args:
        predictor: predictor to ask.
        known: map of all that was observed.
        pose: x, y, yaw of the robot, (3,) [m, m, rad].
        around: map of all that was observed in the square of the predictor's `context_side`; None
            if that is 0, or if no larger map exists.
        copies: copies of `known`, `pose` and `around`, which the predictor gets and may change;
            None: they are made here.

    Raises:
        BadPredictionError: if the predictor raises anything, or breaks the contract.
    """
    given = copied(known, pose, around) if copies is None else copies
    try:
        return checked(predictor.predict(*given), known)
    except BadPredictionError:
        raise
    except (Exception, SystemExit) as error:
        # A plug-in may raise any exception, even when its answer is read.
        raise BadPredictionError(
            f"predict() of {type(predictor).__name__} raised {one_line(error)}"
        ) from error


def copied(known: Grid, pose: NDArray[np.float64], around: Grid | None) -> tuple[Any, ...]:
    """Return deep copies of the arguments of `predict`, without `around` if it is None."""
    return tuple(deepcopy(one) for one in (known, pose, around) if one is not None)


def _lies_within(values: NDArray[Any], low: float, high: float) -> bool:
    """Return whether no value lies outside of [low, high]; NaN counts as inside."""
    ends = values.min(initial=low), values.max(initial=low)
    if np.isnan(ends).any():
        return not ((values < low) | (values > high)).any()
    return bool(low <= ends[0] and ends[1] <= high)
