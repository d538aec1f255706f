"""The example squares in figures: chosen by fixed rules, predicted once more, and stored."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant, entrant
from benchmarks.studies.katyal2018.evaluation import Evaluation, ScoredDrive, hashed
from benchmarks.studies.katyal2018.square import ScoredSquare
from benchmarks.studies.katyal2018.stretch_scores import Kept, drive_of
from benchmarks.studies.katyal2018.transients import with_transients
from predictor.data.squares import TERNARY, codes_of
from predictor.networks import PROPOSED
from predictor.scoring.images import ssim

SHOWN, COLUMNS = 5, 8
"""Number of examples on a sheet, and of predictors side by side."""
WIDEST = 1.7
"""Largest expansion in the paper's figure."""
LASTS = 240
"""Number of frames of the drive in the video, of which every other is shown."""
STRAIGHT, STEP = 0.35, 20
"""Largest change of heading in the video [rad], and number of frames between two candidates for its
start."""
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
expansions as in the paper's figure, "random" and "worst" several squares, "transients" some of the
random ones with added obstacles, "hallway" the frames of the video."""


class Shot(NamedTuple):
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
    """Return the sheets of an evaluation; they are computed once and stored in its folder."""
    from tqdm import tqdm

    chosen = _chosen(evaluation)
    plain = {
        name: [(shot.drive.about["sha256"], *shot[1:]) for shot in shots]
        for name, shots in chosen.items()
    }
    names = shown(one.name for one in evaluation.contestants)
    asked = [one for one in evaluation.contestants if one.name in names]
    who = [(one.name, one.identity, one.expansion) for one in asked]
    part_name = f"{hashed('pictures', plain, who)}.npz"
    part = evaluation.store.read(part_name)
    if part is None:
        arrays: Kept = {}
        facts: dict[str, Any] = {name: [] for name in chosen}
        every = [(name, shot) for name, shots in chosen.items() for shot in shots]
        for name, shot in tqdm(every, desc="pictures", unit="square"):
            row = _row(evaluation, asked, shot, name == "transients")
            number = len(facts[name])
            arrays |= {f"{name}/{number}/{column}": image for column, image in row.images.items()}
            facts[name].append(asdict(row) | {"images": list(row.images)})
        evaluation.store.write(part_name, facts, arrays)
        part = facts, arrays
    facts, arrays = part
    return {
        name: [
            Row(**row | {"images": {key: arrays[f"{name}/{n}/{key}"] for key in row["images"]}})
            for n, row in enumerate(rows)
        ]
        for name, rows in facts.items()
    }


def straight(yaw: NDArray[np.float64], count: int, most: float) -> NDArray[np.intp]:
    """Find the frames at which straight stretches of a drive begin.

    Args:
        yaw: heading along the drive, (n,) [rad].
        count: frames of a stretch, at most n.
        most: largest change of heading within one [rad].
    """
    views = np.lib.stride_tricks.sliding_window_view(np.unwrap(yaw), count)
    return np.flatnonzero(views.max(axis=1) - views.min(axis=1) <= most)


def shown(names: Iterable[str]) -> list[str]:
    """Return the first `COLUMNS` contestants that predict something."""
    return [name for name in dict.fromkeys(names) if name not in NOTHING][:COLUMNS]


def leader_of(evaluation: Evaluation) -> str:
    """Return the name of the contestant whose typical and worst squares are shown.

    Returns:
        The first of `LEADERS`, or the last contestant, among those that predict every expansion.
    """
    # A network of the paper is one contestant for each expansion, all of the same name.
    able = [{one.name for one in evaluation.who(x)} for x in evaluation.expansions]
    names = [one.name for one in evaluation.contestants if all(one.name in has for has in able)]
    return next((name for name in LEADERS if name in names), names[-1])


def _row(evaluation: Evaluation, asked: list[Contestant], shot: Shot, transient: bool) -> Row:
    """Predict a square by all contestants asked, if `transient` with transients in the input."""
    drive, index, expansion, title = shot
    square = ScoredSquare.of(drive_of(drive.folder, drive.number), index, expansion)
    if transient:
        square, _ = with_transients(square, seed=index)
    images = {GIVEN: TERNARY[codes_of(square.crop.cells)]}
    for one in asked:
        if one.does(expansion):
            images[one.name] = entrant(one, evaluation.rates[expansion])(square).image
    alike = {name: ssim(image, square.image) for name, image in images.items() if name != GIVEN}
    images[TRUE] = square.image
    greys = {name: np.rint(255 * image).astype(np.uint8) for name, image in images.items()}
    return Row(title, float(square.pose[2]), greys, alike)


def _chosen(evaluation: Evaluation) -> dict[str, list[Shot]]:
    """Choose the squares of each sheet."""
    expansions = evaluation.expansions
    test = [drive for drive in evaluation.drives if drive.about["split"] == "test"]
    real = [drive for drive in evaluation.drives if drive.about["split"] == "physical"]
    narrow = [x for x in expansions if x <= WIDEST] or list(expansions)
    near, middle = (min(expansions, key=lambda x: abs(x - wanted)) for wanted in (1.3, 1.5))
    out: dict[str, list[Shot]] = {}
    for name, drives in (("simulated", test), ("physical", real)):
        if drives:
            # The median square by SSIM at the middle expansion.
            scored = _scored(evaluation, drives, narrow[len(narrow) // 2])
            one = scored[len(scored) // 2]
            out[name] = [Shot(*one, x, f"{x:.2f}×") for x in narrow]
    every = [(drive, index) for drive in test or real for index in drive.chosen.tolist()]
    rng = np.random.default_rng(0)
    drawn = sorted(rng.choice(len(every), min(SHOWN, len(every)), replace=False))
    out["random"] = [_named(every[i], near) for i in drawn]
    if test:
        # Real drives contain their own transients.
        out["transients"] = out["random"][:3]
    scored_drives = [drive for drive in evaluation.drives if drive.place == "simulated"] or real
    # One square for each drive, so that different failures are shown.
    worst: dict[int, Shot] = {}
    for one in _scored(evaluation, scored_drives, max(expansions)):
        worst.setdefault(one[0].number, _named(one, max(expansions)))
    out["worst"] = list(worst.values())[:SHOWN]
    drive, stretch = _hallway(scored_drives)
    out["hallway"] = [Shot(drive, index, middle, f"{middle:.2f}×") for index in stretch[::2]]
    return out


def _named(one: tuple[ScoredDrive, int], expansion: float) -> Shot:
    """Return a square whose title names its drive and frame."""
    drive, index = one
    return Shot(drive, index, expansion, f"{drive.about['file'].removesuffix('.npz')}, {index}")


def _scored(
    evaluation: Evaluation, drives: list[ScoredDrive], expansion: float
) -> list[tuple[ScoredDrive, int]]:
    """Return drive and frame of all squares, in ascending order of the leader's SSIM."""
    name = leader_of(evaluation)
    leader = next(one for one in evaluation.who(expansion) if one.name == name)
    found: list[tuple[float, ScoredDrive, int]] = []
    for drive in drives:
        parts = evaluation.kept(drive, expansion, leader)
        alike = np.concatenate([kept["ssim"] for _, kept in parts])
        found += zip(alike, [drive] * len(alike), drive.chosen.tolist(), strict=True)
    return [(drive, index) for _, drive, index in sorted(found, key=itemgetter(0))]


def _hallway(drives: list[ScoredDrive]) -> tuple[ScoredDrive, range]:
    """Find the narrowest straight stretch of some drives, the one with the least free space.

    The free space is that in the 5 m crop. If no stretch is straight, return the beginning of the
    first drive.
    """
    best = np.inf
    found = drives[0], range(min(LASTS, drives[0].about["count"]))
    for drive in drives:
        frames = drive_of(drive.folder, drive.number)
        count = min(LASTS, len(frames))
        for first in straight(frames.states[:, 2], count, STRAIGHT)[::STEP]:
            free = float((frames.truth(slice(first, first + count, STEP), 1.0) == 0).mean())
            if free < best:
                best, found = free, (drive, range(first, first + count))
    return found
