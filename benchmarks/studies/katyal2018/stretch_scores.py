"""The scores of contestants on a stretch (some frames) of a drive at one expansion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.contestants import Answer, Contestant, entrant
from benchmarks.studies.katyal2018.square import ScoredSquare
from foresee.infra.errors import LineError
from foresee.prediction import BadPredictionError
from predictor.data.frames import Frames
from predictor.scoring.images import Similarity, similarity
from predictor.scoring.scores import Scores

OF_A_FRAME = (*Similarity.__dataclass_fields__, "brier", "nll", "cells", "nan_cells")
"""Values that are stored for each frame: SSIM in several ways, sums over unobserved cells, and the
number of these cells."""
Kept = dict[str, NDArray[Any]]
"""Arrays that are stored for a stretch: each of `OF_A_FRAME`, and the sums of `Scores`."""


class ScoringError(LineError):
    """A predictor cannot be scored; the message is one line."""


@dataclass(frozen=True)
class Stretch:
    """Some frames of a drive, and the predictors that are asked about them.

    Attributes:
        folder: folder of the set.
        drive: number of the drive in the set.
        frames: numbers of the frames in the drive.
        expansion: expansion of the squares.
        rates: probabilities of the baselines, see `contestants.entrant`.
        contestants: predictors that are asked.
    """

    folder: Path
    drive: int
    frames: tuple[int, ...]
    expansion: float
    rates: tuple[float, float]
    contestants: tuple[Contestant, ...]


def score(stretch: Stretch) -> dict[Contestant, Kept]:
    """Score all predictors of a stretch.

    Raises:
        ScoringError: if a contestant breaks the contract of predictors.
    """
    frames = load_drive(stretch.folder, stretch.drive)
    answers = {asked: entrant(asked, stretch.rates) for asked in stretch.contestants}
    sums = {contestant: Scores() for contestant in answers}
    rows: dict[Contestant, list[tuple[float, ...]]] = {contestant: [] for contestant in answers}
    for index in stretch.frames:
        square = ScoredSquare.of(frames, index, stretch.expansion)
        for contestant, answer_about in answers.items():
            try:
                answer = answer_about(square)
            except BadPredictionError as error:
                where = f"frame {index} of {frames.about[0]['file']} at {stretch.expansion:g}"
                raise ScoringError(f"{contestant.name}, {where}: {error}") from error
            rows[contestant].append(_add(sums[contestant], square, answer))
    return {
        contestant: dict(zip(OF_A_FRAME, np.array(rows[contestant], np.float64).T, strict=True))
        | sums[contestant].arrays("scores")
        for contestant in answers
    }


def _add(sums: Scores, square: ScoredSquare, answer: Answer) -> tuple[float, ...]:
    """Add an answer about a square to the sums, and return the values of `OF_A_FRAME`."""
    similar = similarity(answer.image, answer.kept, square.image, square.unseen)
    brier, nll = _brier(sums), sums.nll.sum()
    truth, ring = square.truth, square.ring
    sums.add(answer.p_free, answer.p_occupied, truth == 0, truth == 1, ring)
    of_cells = _brier(sums) - brier, sums.nll.sum() - nll, int((ring >= 0).sum())
    return (*vars(similar).values(), *of_cells, answer.nan_cells)


def _brier(sums: Scores) -> float:
    return float(0.5 * (sums.brier_free.sum() + sums.brier_occupied.sum()))


def class_shares(frames: Frames, expansion: float) -> tuple[float, float]:
    """Compute the shares of free and of occupied cells among the unobserved ones.

    Args:
        frames: frames to count in.
        expansion: expansion of the squares.
    """
    counts = np.zeros(3, dtype=np.int64)
    # Neighbouring frames of a drive are nearly the same.
    for index in range(0, len(frames), 10):
        square = ScoredSquare.of(frames, index, expansion)
        counts += np.bincount(square.truth[square.ring >= 0], minlength=3)
    free, occupied, _ = counts / max(1, counts.sum())
    return float(free), float(occupied)


@lru_cache(maxsize=2)
def load_drive(folder: Path, drive: int) -> Frames:
    """Return one drive of a data set; cached, since stretches of a drive are scored in turn."""
    return _set(folder).alone(drive)


_set = lru_cache(maxsize=2)(Frames.load)
