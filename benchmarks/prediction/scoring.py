"""A stretch of a drive, scored: what contestants say of its squares at one expansion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.contestants import Answer, Contestant, entrant
from benchmarks.prediction.square import ScoredSquare
from predictor.data.frames import Frames
from predictor.infra.errors import LineError
from predictor.prediction import BadPredictionError
from predictor.scoring.images import Similarity, similarity
from predictor.scoring.scores import Scores

OF_A_FRAME = (*Similarity.__dataclass_fields__, "brier", "nll", "cells", "nan_cells")
"""What is kept of each frame: SSIM, sums over the cells not seen, and how many they are."""
Kept = dict[str, NDArray]
"""What is kept of a stretch: each of `OF_A_FRAME`, and the sums of `Scores`."""


class ScoringError(LineError):
    """A predictor cannot be scored; the message is one line."""


@dataclass(frozen=True)
class Stretch:
    """Some frames of a drive, and who is asked about them.

    Attributes:
        folder: of the set.
        drive: its number in the set.
        frames: their numbers in the drive.
        expansion: of the squares.
        rates: what the baselines say, see `entrants.entrant`.
        contestants: who is asked.
    """

    folder: Path
    drive: int
    frames: tuple[int, ...]
    expansion: float
    rates: tuple[float, float]
    contestants: tuple[Contestant, ...]


@dataclass(eq=False)
class Tally:
    """What one contestant has got so far.

    Attributes:
        scores: sums over cells not seen.
        frames: of each frame, in the order of `OF_A_FRAME`.
    """

    scores: Scores = field(default_factory=Scores)
    frames: list[tuple[float, ...]] = field(default_factory=list)

    def add(self, square: ScoredSquare, answer: Answer) -> None:
        """Score an answer."""
        alike = similarity(answer.image, answer.kept, square.image, square.unseen)
        before = self._sums()
        self.scores.add(answer.p_free, answer.p_occupied, square.truth == 0, square.truth == 1,
                        square.ring)  # fmt: skip
        brier, nll = self._sums() - before
        cells = int((square.ring >= 0).sum())
        self.frames.append((*vars(alike).values(), brier, nll, cells, answer.nan_cells))

    def kept(self) -> Kept:
        """All of it, as arrays."""
        columns = np.array(self.frames, dtype=np.float64).reshape(-1, len(OF_A_FRAME)).T
        return dict(zip(OF_A_FRAME, columns, strict=True)) | self.scores.arrays("scores")

    def _sums(self) -> NDArray[np.float64]:
        both = 0.5 * (self.scores.brier_free.sum() + self.scores.brier_occupied.sum())
        return np.array([both, self.scores.nll.sum()])


def score(stretch: Stretch) -> dict[Contestant, Kept]:
    """Score all that a stretch asks for.

    Raises:
        ScoringError: if a contestant breaks the contract of predictors.
    """
    frames = drive_of(stretch.folder, stretch.drive)
    ready = {one: entrant(one, stretch.rates) for one in stretch.contestants}
    tallies = {one: Tally() for one in stretch.contestants}
    for index in stretch.frames:
        square = ScoredSquare.of(frames, index, stretch.expansion)
        for one, speaker in ready.items():
            try:
                answer = speaker.answer(square)
            except BadPredictionError as error:
                where = f"frame {index} of {frames.about[0]['file']} at {stretch.expansion:g}"
                raise ScoringError(f"{one.name}, {where}: {error}") from error
            tallies[one].add(square, answer)
    return {one: tally.kept() for one, tally in tallies.items()}


def rates_of(frames: Frames, expansion: float, every: int = 10) -> tuple[float, float]:
    """Shares of free and of occupied among the cells not seen.

    Args:
        frames: over which they are counted.
        expansion: of the squares.
        every: only every so manieth frame is looked at.
    """
    counts = np.zeros(3, dtype=np.int64)
    for index in range(0, len(frames), every):
        square = ScoredSquare.of(frames, index, expansion)
        counts += np.bincount(square.truth[square.ring >= 0], minlength=3)
    free, occupied, _ = counts / max(1, counts.sum())
    return float(free), float(occupied)


@lru_cache(maxsize=2)
def drive_of(folder: Path, drive: int) -> Frames:
    """One drive of a set; kept, for its stretches come one after the other."""
    return _set(folder).alone(drive)


@lru_cache(maxsize=2)
def _set(folder: Path) -> Frames:
    return Frames.load(folder)
