"""The example squares in figures, which are chosen by fixed rules."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant, entrant
from benchmarks.studies.katyal2018.evaluation import Evaluation, ScoredDrive
from benchmarks.studies.katyal2018.square import ScoredSquare
from benchmarks.studies.katyal2018.stretch_scores import load_drive
from foresee.infra.progress import progress
from predictor.data.squares import TERNARY, encode_cells
from predictor.networks import PROPOSED
from predictor.scoring.images import ssim

SHOWN, COLUMNS = 5, 8
"""Number of examples on a sheet, and of predictors side by side."""
WIDEST = 1.7
"""Largest expansion in the paper's figure."""
LEADERS = (*PROPOSED, "compact")
"""Candidates for the predictor whose worst and typical squares are shown, in order: the first one
that is compared."""
NOTHING = (*BASELINES, "none")
"""Contestants that predict nothing."""
GIVEN, TRUE = "input", "truth"
"""Columns of a sheet before and after those of the predictors."""


@dataclass(frozen=True, eq=False)
class Row:
    """One square on a sheet.

    Attributes:
        title: title of the row.
        yaw: heading of the car [rad].
        images: column → greys, (n, n) uint8; without predictors of other expansions.
        ssim: predictor → SSIM of its image.
    """

    title: str
    yaw: float
    images: dict[str, NDArray[np.uint8]]
    ssim: dict[str, float]


Sheets = dict[str, list[Row]]
"""Name of a sheet → its squares: "simulated" and "physical" show a median square at several
expansions as in the paper's figure, "worst" the worst square of each of some drives."""


class Example(NamedTuple):
    """A square that is shown.

    Attributes:
        drive: drive that the square belongs to.
        frame: number of the frame in the drive.
        expansion: expansion of the square.
        title: title of the row on the sheet.
    """

    drive: ScoredDrive
    frame: int
    expansion: float
    title: str


def pictures(evaluation: Evaluation) -> Sheets:
    """Return the sheets of an evaluation, with the predictions of the contestants shown."""
    names = shown(contestant.name for contestant in evaluation.contestants)
    asked = [contestant for contestant in evaluation.contestants if contestant.name in names]
    return {
        name: [
            _row(evaluation, asked, example)
            for example in progress(examples, desc=name, unit="square")
        ]
        for name, examples in _chosen(evaluation).items()
    }


def shown(names: Iterable[str]) -> list[str]:
    """Return the first `COLUMNS` contestants that predict something."""
    return [name for name in dict.fromkeys(names) if name not in NOTHING][:COLUMNS]


def pick_leader(evaluation: Evaluation) -> str:
    """Return the name of the contestant whose typical and worst squares are shown.

    Returns:
        The first of `LEADERS`, or the last contestant, among those that predict every expansion.
    """
    # A network of the paper is one contestant for each expansion, all of the same name.
    able = [{each.name for each in evaluation.who(x)} for x in evaluation.expansions]
    names = [each.name for each in evaluation.contestants if all(each.name in of for of in able)]
    return next((name for name in LEADERS if name in names), names[-1])


def _row(evaluation: Evaluation, asked: list[Contestant], example: Example) -> Row:
    """Predict a square by all contestants asked."""
    drive, index, expansion, title = example
    square = ScoredSquare.of(load_drive(drive.folder, drive.number), index, expansion)
    images = {GIVEN: TERNARY[encode_cells(square.crop.cells)]}
    for contestant in asked:
        if contestant.does(expansion):
            answer = entrant(contestant, evaluation.rates[expansion])(square)
            images[contestant.name] = answer.image
    similar = {name: ssim(image, square.image) for name, image in images.items() if name != GIVEN}
    images[TRUE] = square.image
    greys = {name: np.rint(255 * image).astype(np.uint8) for name, image in images.items()}
    return Row(title, float(square.pose[2]), greys, similar)


def _chosen(evaluation: Evaluation) -> dict[str, list[Example]]:
    """Choose the squares of each sheet."""
    expansions = evaluation.expansions
    test = [drive for drive in evaluation.drives if drive.about["split"] == "test"]
    real = [drive for drive in evaluation.drives if drive.about["split"] == "physical"]
    narrow = [x for x in expansions if x <= WIDEST] or list(expansions)
    out: dict[str, list[Example]] = {}
    for name, drives in (("simulated", test), ("physical", real)):
        if drives:
            # The median square by SSIM at the middle expansion.
            scored = _scored(evaluation, drives, narrow[len(narrow) // 2])
            drive, index = scored[len(scored) // 2]
            out[name] = [Example(drive, index, x, f"{x:.2f}×") for x in narrow]
    simulated = [drive for drive in evaluation.drives if drive.place == "simulated"]
    # One square for each drive, so that different failures are shown.
    widest, worst = max(expansions), dict[int, Example]()
    for drive, index in _scored(evaluation, simulated or real, widest):
        title = f"{drive.about['file'].removesuffix('.npz')}, {index}"
        worst.setdefault(drive.number, Example(drive, index, widest, title))
    out["worst"] = list(worst.values())[:SHOWN]
    return out


def _scored(
    evaluation: Evaluation, drives: list[ScoredDrive], expansion: float
) -> list[tuple[ScoredDrive, int]]:
    """Return drive and frame of all squares, in ascending order of the leader's SSIM."""
    name = pick_leader(evaluation)
    leader = next(each for each in evaluation.who(expansion) if each.name == name)
    squares: list[tuple[float, ScoredDrive, int]] = []
    for drive in drives:
        parts = evaluation.kept(drive, expansion, leader)
        similar = np.concatenate([arrays["ssim"] for _, arrays in parts])
        squares += zip(similar, [drive] * len(similar), drive.chosen.tolist(), strict=True)
    return [(drive, index) for _, drive, index in sorted(squares, key=itemgetter(0))]
