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


class Tally:
    """The sums of the scores of one predictor over the squares added so far."""

    def __init__(self) -> None:
        self.scores, self.frames = Scores(), list[tuple[float, ...]]()

    def add(self, square: ScoredSquare, answer: Answer) -> None:
        """Add the scores of an answer."""
        alike = similarity(answer.image, answer.kept, square.image, square.unseen)
        before = self._sums()
        truth, ring = square.truth, square.ring
        self.scores.add(answer.p_free, answer.p_occupied, truth == 0, truth == 1, ring)
        brier, nll = self._sums() - before
        cells = int((ring >= 0).sum())
        self.frames.append((*vars(alike).values(), brier, nll, cells, answer.nan_cells))

    def kept(self) -> Kept:
        """Return all scores as arrays."""
        columns = np.array(self.frames, dtype=np.float64).reshape(-1, len(OF_A_FRAME)).T
        return dict(zip(OF_A_FRAME, columns, strict=True)) | self.scores.arrays("scores")

    def _sums(self) -> NDArray[np.float64]:
        both = 0.5 * (self.scores.brier_free.sum() + self.scores.brier_occupied.sum())
        return np.array([both, self.scores.nll.sum()])


def score(stretch: Stretch) -> dict[Contestant, Kept]:
    """Score all predictors of a stretch.

    Raises:
        ScoringError: if a contestant breaks the contract of predictors.
    """
    frames = drive_of(stretch.folder, stretch.drive)
    ready = {one: entrant(one, stretch.rates) for one in stretch.contestants}
    tallies = {one: Tally() for one in stretch.contestants}
    for index in stretch.frames:
        square = ScoredSquare.of(frames, index, stretch.expansion)
        for one, answer_about in ready.items():
            try:
                answer = answer_about(square)
            except BadPredictionError as error:
                where = f"frame {index} of {frames.about[0]['file']} at {stretch.expansion:g}"
                raise ScoringError(f"{one.name}, {where}: {error}") from error
            tallies[one].add(square, answer)
    return {one: tally.kept() for one, tally in tallies.items()}


def rates_of(frames: Frames, expansion: float, every: int = 10) -> tuple[float, float]:
    """Compute the shares of free and of occupied cells among the unobserved ones.

    Args:
        frames: frames to count in.
        expansion: expansion of the squares.
        every: step from one counted frame to the next.
    """
    counts = np.zeros(3, dtype=np.int64)
    for index in range(0, len(frames), every):
        square = ScoredSquare.of(frames, index, expansion)
        counts += np.bincount(square.truth[square.ring >= 0], minlength=3)
    free, occupied, _ = counts / max(1, counts.sum())
    return float(free), float(occupied)


@lru_cache(maxsize=2)
def drive_of(folder: Path, drive: int) -> Frames:
    """Return one drive of a data set; cached, since stretches of a drive are scored in turn."""
    return _set(folder).alone(drive)


_set = lru_cache(maxsize=2)(Frames.load)
