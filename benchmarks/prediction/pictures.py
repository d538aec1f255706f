"""The squares shown in figures: chosen by rules, predicted once more, and kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.contestants import BASELINES, Contestant, entrant
from benchmarks.prediction.evaluation import Drive, Evaluation
from benchmarks.prediction.scoring import Kept, drive_of
from benchmarks.prediction.square import ScoredSquare
from benchmarks.prediction.transients import with_transients
from predictor.data.squares import TERNARY, codes_of
from predictor.scoring.images import ssim

SHOWN, COLUMNS = 5, 8
"""Number of examples on a sheet, and of predictors beside each other."""
WIDEST = 1.7
"""Largest expansion in the paper's figure."""
LASTS = 240
"""Number of frames of the drive in the video, of which every other is shown."""
STRAIGHT, STEP = 0.35, 20
"""Largest change of heading in the video [rad], and frames between two candidates for its start."""
LEADERS = ("unet_ff", "resnet_ff", "gan", "compact")
"""Predictors whose failures and typical squares are shown: the first that is compared."""
NOTHING = (*BASELINES, "none")
"""Contestants that predict nothing."""
GIVEN, TRUE = "input", "truth"
"""Columns beside those of the predictors."""


@dataclass(frozen=True, eq=False)
class Row:
    """One square on a sheet.

    Attributes:
        title: title of the row.
        yaw: heading of the car [rad].
        images: column → greys, (n, n) uint8; none for predictors of other expansions.
        ssim: predictor → SSIM of its image.
    """

    title: str
    yaw: float
    images: dict[str, NDArray[np.uint8]]
    ssim: dict[str, float]


Sheets = dict[str, list[Row]]
"""Name → what is on it: "simulated" and "physical" are the paper's figure, "random" and "worst"
what they say, "transients" some of the random ones with obstacles put in, "hallway" the frames of
the video."""
Asked = tuple[Drive, int, float]
"""A drive, the number of a frame in it, and an expansion."""


def pictures(evaluation: Evaluation) -> Sheets:
    """Return all squares shown of an evaluation, and keep them."""
    chosen = _chosen(evaluation)
    plain = {
        name: [
            (drive.about["sha256"], index, expansion, title)
            for (drive, index, expansion), title in rows
        ]
        for name, rows in chosen.items()
    }
    who = [(one.name, one.identity, one.expansion) for one in _shown(evaluation)]
    part_name = evaluation.store.name("pictures", plain, who)
    part = evaluation.store.read(part_name)
    if part is not None:
        return _kept(*part)
    sheets = _made(evaluation, chosen)
    arrays: Kept = {}
    facts: dict[str, Any] = {name: [] for name in sheets}
    for name, rows in sheets.items():
        for number, row in enumerate(rows):
            arrays |= {f"{name}/{number}/{column}": image for column, image in row.images.items()}
            facts[name].append(asdict(row) | {"images": list(row.images)})
    evaluation.store.write(part_name, facts, arrays)
    return sheets


def _kept(facts: dict[str, Any], arrays: Kept) -> Sheets:
    """Return the sheets that `pictures` has written."""
    sheets: Sheets = {}
    for name, rows in facts.items():
        sheets[name] = []
        for number, row in enumerate(rows):
            images = {column: arrays[f"{name}/{number}/{column}"] for column in row["images"]}
            sheets[name].append(Row(row["title"], row["yaw"], images, row["ssim"]))
    return sheets


def straight(yaw: NDArray[np.float64], count: int, most: float) -> NDArray[np.intp]:
    """Find where the straight stretches of a drive begin.

    Args:
        yaw: heading along the drive, (n,) [rad].
        count: frames of a stretch, at most n.
        most: largest change of heading within one [rad].
    """
    views = np.lib.stride_tricks.sliding_window_view(np.unwrap(yaw), count)
    return np.flatnonzero(views.max(axis=1) - views.min(axis=1) <= most)


def _shown(evaluation: Evaluation) -> list[Contestant]:
    """Return the contestants shown on sheets."""
    every = evaluation.config.contestants
    names = shown(one.name for one in every)
    return [one for one in every if one.name in names]


def shown(names: Iterable[str]) -> list[str]:
    """Return the first contestants that predict something, as many as a figure can show."""
    return [name for name in dict.fromkeys(names) if name not in NOTHING][:COLUMNS]


def _made(evaluation: Evaluation, chosen: dict[str, list[tuple[Asked, str]]]) -> Sheets:
    from tqdm import tqdm

    total = sum(map(len, chosen.values()))
    with tqdm(total=total, desc="pictures", unit="square") as bar:

        def row(asked: Asked, title: str, transient: bool) -> Row:
            bar.update()
            return _row(evaluation, asked, title, transient)

        return {
            name: [row(*each, name == "transients") for each in rows]
            for name, rows in chosen.items()
        }


def _row(evaluation: Evaluation, asked: Asked, title: str, transient: bool) -> Row:
    drive, index, expansion = asked
    square = ScoredSquare.of(drive_of(drive.folder, drive.number), index, expansion)
    if transient:
        square, _ = with_transients(square, seed=index)
    images, alike = {GIVEN: TERNARY[codes_of(square.crop.cells)]}, {}
    for one in _shown(evaluation):
        if one.does(expansion):
            said = entrant(one, evaluation.rates[expansion]).answer(square).image
            images[one.name] = said
            alike[one.name] = ssim(said, square.image)
    images[TRUE] = square.image
    greys = {name: np.rint(255 * image).astype(np.uint8) for name, image in images.items()}
    return Row(title, float(square.pose[2]), greys, alike)


def _chosen(evaluation: Evaluation) -> dict[str, list[tuple[Asked, str]]]:
    """Choose the squares of each sheet."""
    expansions = evaluation.config.expansions
    test = [drive for drive in evaluation.drives if drive.about["split"] == "test"]
    real = [drive for drive in evaluation.drives if drive.about["split"] == "physical"]
    narrow = [x for x in expansions if x <= WIDEST] or list(expansions)
    out: dict[str, list[tuple[Asked, str]]] = {}
    for name, drives in (("simulated", test), ("physical", real)):
        if drives:
            drive, index = _typical(evaluation, drives, narrow[len(narrow) // 2])
            out[name] = [((drive, index, x), f"{x:.2f}×") for x in narrow]
    near, far = min(expansions, key=lambda x: abs(x - 1.3)), max(expansions)
    rng = np.random.default_rng(0)
    every = [(drive, int(index)) for drive in test or real for index in drive.chosen]
    drawn = sorted(rng.choice(len(every), min(SHOWN, len(every)), replace=False))
    out["random"] = [((*every[i], near), _told(*every[i])) for i in drawn]
    scored = [drive for drive in evaluation.drives if drive.place == "simulated"] or real
    if test:
        # Real drives contain their own transients.
        out["transients"] = [((*every[i], near), _told(*every[i])) for i in drawn[:3]]
    out["worst"] = [((*one, far), _told(*one)) for one in _worst(evaluation, scored, far)]
    drive, stretch = _hallway(scored)
    middle = min(expansions, key=lambda x: abs(x - 1.5))
    out["hallway"] = [((drive, index, middle), f"{middle:.2f}×") for index in stretch[::2]]
    return out


def _told(drive: Drive, index: int) -> str:
    return f"{drive.about['file'].removesuffix('.npz')}, {index}"


def leader(names: list[str]) -> str:
    """Return the contestant whose failures are shown: the first of LEADERS, else the last."""
    return next((name for name in LEADERS if name in names), names[-1])


def _scored(
    evaluation: Evaluation, drives: list[Drive], expansion: float
) -> list[tuple[float, Drive, int]]:
    """Return SSIM of the leader on all squares with drive and frame, in ascending order."""
    who = {one.name: one for one in evaluation.who(expansion)}
    one = who[leader(list(who))]
    out = []
    for drive in drives:
        alike = [kept["ssim"] for _, kept in evaluation.kept(drive, expansion, one)]
        for value, index in zip(np.concatenate(alike), drive.chosen, strict=True):
            out.append((float(value), drive, int(index)))
    return sorted(out, key=itemgetter(0))


def _typical(evaluation: Evaluation, drives: list[Drive], expansion: float) -> tuple[Drive, int]:
    """Return the square with the leader's median SSIM."""
    scored = _scored(evaluation, drives, expansion)
    return scored[len(scored) // 2][1:]


def _hallway(drives: list[Drive]) -> tuple[Drive, range]:
    """Find the narrowest straight stretch of these drives: the least free space in the 5 m crop.

    If none is straight, return the beginning of the first drive.
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


def _worst(
    evaluation: Evaluation, drives: list[Drive], expansion: float
) -> list[tuple[Drive, int]]:
    """Return the leader's worst squares, one for each drive, so that they show several failures."""
    found: dict[int, tuple[Drive, int]] = {}
    for _, drive, index in _scored(evaluation, drives, expansion):
        found.setdefault(drive.number, (drive, index))
    return list(found.values())[:SHOWN]
