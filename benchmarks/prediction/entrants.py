"""What each contestant says of a square: a grey image, and probabilities."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.contestants import BASELINES, Contestant
from benchmarks.prediction.square import ScoredSquare
from predictor.data.squares import TERNARY, codes_of
from predictor.fused import Fused
from predictor.image_predictor import ImagePredictor
from predictor.prediction import BadPredictionError, Predictor, asked
from predictor.registry import load_predictor
from predictor.scoring.ternary import ternary


@dataclass(frozen=True, eq=False)
class Answer:
    """What is said of a square, (n, n) each.

    Attributes:
        image: greys in [0, 1]: free 1, not known 0.5, occupied 0.
        kept: the same, in which what the predictor was given is as it was given.
        p_free: probability of free; only cells not seen count.
        p_occupied: likewise.
        nan_cells: how many were NaN, which count as not known.
    """

    image: NDArray[np.float64]
    kept: NDArray[np.float64]
    p_free: NDArray[np.float32]
    p_occupied: NDArray[np.float32]
    nan_cells: int = 0


class Entrant(Protocol):
    """A contestant that is ready."""

    def answer(self, square: ScoredSquare) -> Answer:
        """What it says.

        Raises:
            BadPredictionError: if it breaks the contract of predictors.
        """
        ...


def entrant(contestant: Contestant, rates: tuple[float, float]) -> Entrant:
    """Make a contestant ready.

    Args:
        contestant: who.
        rates: shares of free and of occupied among cells not seen, which is what the baselines
            say of these.
    """
    if contestant.name in BASELINES:
        return _Baseline(contestant.name == "copy", rates)
    predictor = _loaded(contestant.spec)
    if is_printed(predictor):
        return _Printed(predictor)
    return _Believed(predictor)


def is_printed(predictor: Any) -> TypeGuard[ImagePredictor | Fused]:
    """Whether a predictor is made of networks that print a grey image."""
    return isinstance(predictor, ImagePredictor | Fused)


def prints(contestant: Contestant) -> bool:
    """Whether a contestant is such a predictor."""
    return contestant.name not in BASELINES and is_printed(_loaded(contestant.spec))


@dataclass(frozen=True)
class _Baseline:
    """The crop as it is, or nothing.

    Its one grey of cells not seen means what such cells are on the validation drives.
    """

    copies: bool
    rates: tuple[float, float]

    def answer(self, square: ScoredSquare) -> Answer:
        crop = TERNARY[codes_of(square.crop.cells)]
        image = crop if self.copies else np.full_like(crop, 0.5)
        free, occupied = (np.full(crop.shape, rate, np.float32) for rate in self.rates)
        return Answer(image, image, free, occupied)


@dataclass(frozen=True)
class _Printed:
    """A network of the paper: its raw image is scored, and what its greys mean."""

    predictor: ImagePredictor | Fused

    def answer(self, square: ScoredSquare) -> Answer:
        known = square.crop if self.predictor.given == "crop" else square.window
        grey, p_free, p_occupied, _ = self.predictor.printed(known, square.pose)
        if not np.isfinite(grey).all():
            raise BadPredictionError("the network printed numbers that are not finite")
        image = 0.5 + 0.5 * grey.astype(np.float64)
        kept = np.where(known.unknown, image, TERNARY[codes_of(known.cells)])
        return Answer(image, kept, p_free, p_occupied)


@dataclass(frozen=True)
class _Believed:
    """Any predictor, given what a planner would give it."""

    predictor: Predictor

    def answer(self, square: ScoredSquare) -> Answer:
        belief = asked(self.predictor, square.window, square.pose)
        image = ternary(square.window, belief)
        return Answer(image, image, belief.p_free, belief.p_occupied, belief.nan_cells)


@lru_cache(maxsize=8)
def _loaded(spec: str) -> Predictor:
    return load_predictor(spec)
