"""An evaluation: the scored squares, the contestants, and the scores kept in a folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant
from benchmarks.studies.katyal2018.stretch_scores import Stretch, class_shares, score
from foresee.infra.environment import commit
from foresee.infra.part_file import Part
from foresee.infra.progress import progress
from foresee.infra.resumable import ResumableFolder
from foresee.infra.workers import finished
from foresee.mapping.polyline import arc_length
from predictor.data.frames import MANIFEST, Frames, FramesError, checksum, read_manifest

VERSION = 3
"""Version of the measures, which changes with the definition of any of them."""
SPLITS = ("test", "more")
"""Splits of a simulated set that are scored."""
TOGETHER = 100
"""Number of frames of a stretch, which is the unit of work."""
UNMEASURED = (0.5, 0.5)
"""Probabilities that the baselines return if there are no validation drives to measure them on."""
BLOCK = 10.0
"""Length of a block of a real drive [m]; the frames of a block are resampled together. It is the
side of the widest square, so that squares of blocks that are not neighbours share no cell, unless
the drive returns to a place."""


@dataclass(frozen=True, eq=False)
class ScoredDrive:
    """A drive that is scored.

    Attributes:
        place: "simulated", or name of the site.
        folder: folder of its data set.
        number: number of the drive in its data set.
        about: facts of the drive from the manifest.
        chosen: numbers of the scored frames, (k,).
        driven: distance driven up to each scored frame, (k,) [m].
    """

    place: str
    folder: Path
    number: int
    about: dict[str, Any]
    chosen: NDArray[np.intp]
    driven: NDArray[np.float64]

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Number of the block of each scored frame, (k,); a simulated drive is one block."""
        if self.place == "simulated":
            return np.full(len(self.chosen), self.number)
        return (self.driven / BLOCK).astype(np.int64)


class Evaluation:
    """An evaluation in a folder.

    Args:
        out: folder of the evaluation.
        data: folder of the simulated set; None: there is none.
        logs: folder of the physical set; None: there is none.
        expansions: expansions of the squares.
        apart: least distance from one scored frame to the next along a drive [m].
        contestants: predictors that are compared.

    Attributes:
        sets: kind of the set ("simulated", "physical") → its frames.
        drives: drives that are scored.
        rates: expansion → shares of free and of occupied cells on the validation drives.

    Raises:
        FramesError: if a set cannot be read, or is not of the kind that it should be.
    """

    def __init__(
        self,
        out: Path,
        data: Path | None,
        logs: Path | None,
        expansions: Sequence[float],
        apart: float,
        contestants: Sequence[Contestant],
    ) -> None:
        self.out, self.data, self.apart = out, data, apart
        self.expansions, self.contestants = expansions, contestants
        folders = {"simulated": data, "physical": logs}
        self.sets = {kind: _of_kind(folder, kind) for kind, folder in folders.items() if folder}
        self.drives = [drive for frames in self.sets.values() for drive in _drives(frames, apart)]
        self.store = ResumableFolder(out / "parts")
        self.rates = dict.fromkeys(expansions, UNMEASURED)
        if data is not None:
            validation = Frames.load(data, "validation")
            self.rates = {x: class_shares(validation, x) for x in expansions}

    @property
    def places(self) -> list[str]:
        """Places of the drives: "simulated", and the names of the sites."""
        return list(dict.fromkeys(drive.place for drive in self.drives))

    def who(self, expansion: float) -> list[Contestant]:
        """Return the contestants that can predict squares of an expansion."""
        return [contestant for contestant in self.contestants if contestant.does(expansion)]

    def stretches(self, drive: ScoredDrive, expansion: float) -> list[Stretch]:
        """Return the stretches of a drive at an expansion."""
        rates, who = self.rates[expansion], tuple(self.who(expansion))
        frames = drive.chosen.tolist()
        parts = [tuple(frames[i : i + TOGETHER]) for i in range(0, len(frames), TOGETHER)]
        return [Stretch(drive.folder, drive.number, part, expansion, rates, who) for part in parts]

    def run(self, jobs: int) -> None:
        """Compute the missing scores, with a progress bar over the answers of contestants.

        Raises:
            ScoringError: if a predictor breaks its contract.
            WorkersError: if processes keep dying.
        """

        sha256 = {(drive.folder, drive.number): drive.about["sha256"] for drive in self.drives}

        def name(stretch: Stretch, contestant: Contestant) -> str:
            return _scores_name(stretch, sha256[stretch.folder, stretch.drive], contestant)

        def answers(stretches: list[Stretch]) -> int:
            return sum(len(stretch.frames) * len(stretch.contestants) for stretch in stretches)

        # Ordered by expansion, since only the networks of one expansion fit into memory.
        every = [
            stretch
            for expansion in self.expansions
            for drive in self.drives
            for stretch in self.stretches(drive, expansion)
        ]
        todo = []
        for stretch in every:
            asked = stretch.contestants
            left = [
                contestant
                for contestant in asked
                if self.store.read(name(stretch, contestant)) is None
            ]
            if left:
                todo.append(replace(stretch, contestants=tuple(left)))
        total = answers(every)
        done = total - answers(todo)
        with progress(total=total, initial=done, unit="answer", smoothing=0.05) as bar:
            for stretch, kept in finished(score, todo, jobs):
                for contestant, arrays in kept.items():
                    self.store.write(name(stretch, contestant), {"commit": commit()}, arrays)
                bar.update(answers([stretch]))

    def kept(self, drive: ScoredDrive, expansion: float, contestant: Contestant) -> Iterator[Part]:
        """Yield facts and scores of a contestant for each stretch of a drive, in order.

        Raises:
            FileNotFoundError: if a stretch has not been scored.
        """
        for stretch in self.stretches(drive, expansion):
            name = _scores_name(stretch, drive.about["sha256"], contestant)
            part = self.store.read(name)
            if part is None:
                raise FileNotFoundError(
                    f"{self.store.folder / name} is missing: give the same command again"
                )
            yield part


def hashed(kind: str, *decided_by: Any) -> str:
    """Return the name of a part without its ending: a hash of all that decides its content.

    The same command therefore computes nothing twice, and predictors, expansions and sites can be
    added to a folder.

    Args:
        kind: beginning of the name.
        decided_by: plain data that decide the content of the part.
    """
    text = json.dumps([VERSION, kind, *decided_by])
    return f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:24]}"


def _scores_name(stretch: Stretch, sha256: str, contestant: Contestant) -> str:
    """Return the name of the scores of a contestant on a stretch of the drive with a checksum."""
    own = stretch.rates if contestant.name in BASELINES else contestant.expansion
    key = hashed("scores", sha256, stretch.frames, stretch.expansion, contestant.identity, own)
    return f"{key}.npz"


def expansion_key(expansion: float) -> str:
    """Return the key of an expansion in the results, such as "1.30"."""
    return f"{expansion:.2f}"


def describe_sets(evaluation: Evaluation) -> dict[str, Any]:
    """Return the facts of the data sets for the results."""
    out = {}
    for kind, frames in evaluation.sets.items():
        manifest = read_manifest(frames.folder)
        out[kind] = {"manifest_sha256": checksum(frames.folder / MANIFEST)} | {
            name: manifest.get(name) for name in ("version", "settings", "trajectories")
        }
    return out


def _of_kind(folder: Path, kind: str) -> Frames:
    frames = Frames.load(folder)
    actual = read_manifest(folder).get("kind")
    if actual != kind:
        raise FramesError(f"{folder} holds a {actual} set, not a {kind} one")
    return frames


def _drives(frames: Frames, apart: float) -> list[ScoredDrive]:
    """Return the drives of a set that are scored, with their frames."""
    out = []
    for number, about in enumerate(frames.about):
        if about["split"] not in (*SPLITS, "physical"):
            continue
        driven = arc_length(frames.states[frames.trajectory == number])
        chosen = spaced(driven, apart)
        place = about["map"] if about["split"] == "physical" else "simulated"
        out.append(ScoredDrive(place, frames.folder, number, about, chosen, driven[chosen]))
    return out


def spaced(driven: NDArray[np.float64], apart: float) -> NDArray[np.intp]:
    """Choose frames of a drive: the first, and each that is far enough from the last chosen one.

    Args:
        driven: distance driven up to each frame, (n,) [m].
        apart: least distance between two chosen frames [m]; 0: all are chosen.

    Returns:
        Numbers of the chosen frames.
    """
    chosen, last = [], -np.inf
    for index, distance in enumerate(driven):
        # With a tolerance for rounding errors of the summed steps.
        if distance - last >= apart - 1e-4:
            chosen.append(index)
            last = distance
    return np.array(chosen, dtype=np.intp)
