"""The contract between a predictor and everything that uses one."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from predictor.infra.errors import LineError, one_line
from predictor.mapping.grid import Grid, GridFrame


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is believed of a piece of map, cell by cell.

    The rest, 1 - p_free - p_occupied, is the probability that nothing will ever be observed
    there, such as inside a wall.

    Attributes:
        frame: where the cells lie.
        p_free: probability that a cell is free, (rows, columns).
        p_occupied: probability that a cell is a surface that a ray can hit, (rows, columns).
        confidence: trust in the two, in [0, 1], (rows, columns). 0 means unknown.
        hypotheses: optionally, K maps that are each consistent in themselves, as probabilities
            of free: (K, rows, columns).
        nan_cells: how many cells not seen were NaN, and are unknown now: for `checked` to say.
    """

    frame: GridFrame
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    confidence: NDArray[np.float32]
    hypotheses: NDArray[np.float32] | None = None
    nan_cells: int = 0


@runtime_checkable
class Predictor(Protocol):
    """Anything that extends a known map: the one method a plug-in has to offer."""

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Predict a map.

        Args:
            known: all that has been seen inside the predicted window, which is `expansion`
                times as wide as the sensed one and centred on the robot.
            pose: x, y, yaw of the robot, (3,) [m, m, rad].

        Returns:
            A prediction on the frame of `known`.
        """
        ...


class BadPredictionError(LineError):
    """A predictor returned something that breaks its contract."""


def checked(prediction: Prediction, known: Grid) -> Prediction:
    """A predictor's answer, if it may be used, with observed cells as they were observed.

    A NaN in a probability or in a confidence makes its cell unknown, and is counted.

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
        # A copy: a plug-in may go on writing into its own arrays.
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
    hypotheses = prediction.hypotheses
    if hypotheses is not None:
        hypotheses = np.array(hypotheses)
        if hypotheses.shape[1:] != shape or not ((hypotheses >= 0) & (hypotheses <= 1)).all():
            raise BadPredictionError(f"hypotheses must be (K, {shape[0]}, {shape[1]}) in [0, 1]")
    seen = {"p_free": known.free, "p_occupied": known.occupied, "confidence": ~known.unknown}
    for name, observed in seen.items():
        kept = np.where(known.unknown, fields[name], observed)
        fields[name] = kept.astype(np.float32, copy=False)
    return Prediction(known.frame, **fields, hypotheses=hypotheses, nan_cells=nan_cells)


def asked(
    predictor: Predictor,
    known: Grid,
    pose: NDArray[np.float64],
    copies: tuple[Grid, NDArray[np.float64]] | None = None,
) -> Prediction:
    """A predictor's checked answer; whatever else it raises is a `BadPredictionError` too.

    Args:
        predictor: asked.
        known: what has been seen.
        pose: x, y, yaw of the robot, (3,) [m, m, rad].
        copies: of the two, for the predictor, which may write into them; made if None.

    Raises:
        BadPredictionError: if it raises, or breaks the contract.
    """
    given = (deepcopy(known), pose.copy()) if copies is None else copies
    try:
        return checked(predictor.predict(*given), known)
    except BadPredictionError:
        raise
    except (Exception, SystemExit) as error:
        # A stranger's code may raise whatever it likes, also when its answer is read.
        raise BadPredictionError(
            f"predict() of {type(predictor).__name__} raised {one_line(error)}"
        ) from error


def _lies_within(values: NDArray, low: float, high: float) -> bool:
    """Whether no value lies outside; a NaN does not."""
    ends = values.min(initial=low), values.max(initial=low)
    if np.isnan(ends).any():
        return not ((values < low) | (values > high)).any()
    return bool(low <= ends[0] and ends[1] <= high)
