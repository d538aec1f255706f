"""An evaluation: the squares, the predictors that are asked about them, and their scores."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.contestants import Contestant
from benchmarks.prediction.scoring import Stretch, rates_of, score
from benchmarks.prediction.square import ScoredSquare
from benchmarks.prediction.store import Store
from predictor.data.frames import MANIFEST, Frames, FramesError, checksum, read_manifest
from predictor.infra.environment import commit
from predictor.infra.resumable import Part
from predictor.infra.workers import finished

SPLITS = ("test", "more")
"""Splits of a simulated set that are scored."""
TOGETHER = 100
"""Frames of a stretch, which is the unit of work."""
UNTOLD = (0.5, 0.5)
"""Probabilities that the baselines give to unobserved cells without validation drives."""
BLOCK = 10.0
"""Length of a block of a real drive that is resampled as one [m]. It is the side of the widest
square, so that squares of blocks that are no neighbours share no cell, unless the drive returns."""


@dataclass(frozen=True)
class Config:
    """Settings of an evaluation.

    Attributes:
        data: folder of the simulated set; None: there is none.
        logs: folder of the physical set; None: there is none.
        expansions: expansions of the squares.
        apart: distance from one scored frame to the next along a drive [m].
        contestants: predictors that are compared.
    """

    data: Path | None
    logs: Path | None
    expansions: tuple[float, ...]
    apart: float
    contestants: tuple[Contestant, ...]


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive that is scored.

    Attributes:
        place: "simulated", or the site.
        folder: folder of its set.
        number: number in its set.
        about: facts of it from the manifest.
        chosen: numbers of the scored frames, (k,).
        ways: distance driven up to each of them [m], (k,).
    """

    place: str
    folder: Path
    number: int
    about: dict[str, Any]
    chosen: NDArray[np.intp]
    ways: NDArray[np.float64]

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Block of each scored frame, (k,); a simulated drive is one block."""
        if self.place == "simulated":
            return np.full(len(self.chosen), self.number)
        return (self.ways / BLOCK).astype(np.int64)


class Evaluation:
    """An evaluation in a folder.

    Args:
        config: settings.
        out: folder of the evaluation.

    Raises:
        FramesError: if a set cannot be read, or is not of the kind that it should be.
    """

    def __init__(self, config: Config, out: Path) -> None:
        self.config, self.out = config, out
        folders = {"simulated": config.data, "physical": config.logs}
        self.sets = {kind: _of_kind(folder, kind) for kind, folder in folders.items() if folder}
        """Kind → frames of its set, if there is one."""
        self.drives = [
            drive for frames in self.sets.values() for drive in _drives(frames, config.apart)
        ]
        self.store = Store(out / "parts")
        self.rates = dict.fromkeys(config.expansions, UNTOLD)
        """Expansion → shares of free and of occupied cells on the validation drives."""
        if config.data is not None:
            validation = Frames.load(config.data, "validation")
            self.rates = {x: rates_of(validation, x) for x in config.expansions}

    @property
    def places(self) -> list[str]:
        """ "simulated", and the sites."""
        return list(dict.fromkeys(drive.place for drive in self.drives))

    def who(self, expansion: float) -> list[Contestant]:
        """Return the contestants that can predict squares of an expansion."""
        return [one for one in self.config.contestants if one.does(expansion)]

    def stretches(self, drive: Drive, expansion: float) -> list[Stretch]:
        """Return the stretches of a drive."""
        return [
            Stretch(
                drive.folder,
                drive.number,
                tuple(map(int, drive.chosen[i : i + TOGETHER])),
                expansion,
                self.rates[expansion],
                tuple(self.who(expansion)),
            )
            for i in range(0, len(drive.chosen), TOGETHER)
        ]

    def run(self, jobs: int) -> None:
        """Score what is missing, with a progress bar over answers.

        Raises:
            ScoringError: if a predictor breaks its contract.
            WorkersError: if processes keep dying.
        """
        from tqdm import tqdm

        sha256 = {(drive.folder, drive.number): drive.about["sha256"] for drive in self.drives}

        def name(stretch: Stretch, one: Contestant) -> str:
            return self.store.scores_name(stretch, sha256[stretch.folder, stretch.drive], one)

        # Ordered by expansion: the networks of one fit into memory, those of all do not.
        every = [
            stretch
            for expansion in self.config.expansions
            for drive in self.drives
            for stretch in self.stretches(drive, expansion)
        ]
        todo = []
        for stretch in every:
            left = [
                one for one in stretch.contestants if self.store.read(name(stretch, one)) is None
            ]
            if left:
                todo.append(replace(stretch, contestants=tuple(left)))
        total = sum(len(stretch.frames) * len(stretch.contestants) for stretch in every)
        missing = sum(len(stretch.frames) * len(stretch.contestants) for stretch in todo)
        with tqdm(total=total, initial=total - missing, unit="answer", smoothing=0.05) as bar:
            for stretch, kept in finished(score, todo, jobs):
                for one, arrays in kept.items():
                    self.store.write(name(stretch, one), {"commit": commit()}, arrays)
                bar.update(len(stretch.frames) * len(stretch.contestants))

    def kept(self, drive: Drive, expansion: float, one: Contestant) -> Iterator[Part]:
        """Yield facts and scores of a contestant along a drive, in order.

        Raises:
            FileNotFoundError: if something has not been scored.
        """
        for stretch in self.stretches(drive, expansion):
            name = self.store.scores_name(stretch, drive.about["sha256"], one)
            part = self.store.read(name)
            if part is None:
                raise FileNotFoundError(
                    f"{self.store.folder / name} is missing: give the same command again"
                )
            yield part

    def examples(self, expansion: float, count: int = 20) -> list[ScoredSquare]:
        """Return squares spread evenly over the test drives, or the logs, to measure costs on."""
        frames = self.sets.get("physical")
        if self.config.data is not None:
            frames = Frames.load(self.config.data, "test")
        assert frames is not None
        chosen = np.unique(np.linspace(0, len(frames) - 1, count).astype(int))
        return [ScoredSquare.of(frames, int(index), expansion) for index in chosen]


def key_of(expansion: float) -> str:
    """Return the name of an expansion in the results."""
    return f"{expansion:.2f}"


def sets_of(evaluation: Evaluation) -> dict[str, Any]:
    """Return the facts of the sets for the results."""
    config = evaluation.config
    out = {}
    for kind, folder in (("simulated", config.data), ("physical", config.logs)):
        if folder is not None:
            manifest = read_manifest(folder)
            out[kind] = {"manifest_sha256": checksum(folder / MANIFEST)} | {
                name: manifest.get(name) for name in ("version", "settings", "trajectories")
            }
    return out


def _of_kind(folder: Path, kind: str) -> Frames:
    frames = Frames.load(folder)
    theirs = read_manifest(folder).get("kind")
    if theirs != kind:
        raise FramesError(f"{folder} holds a {theirs} set, not a {kind} one")
    return frames


def _drives(frames: Frames, apart: float) -> list[Drive]:
    """Return the drives of a set that are scored, with their frames."""
    out = []
    for number, about in enumerate(frames.about):
        if about["split"] not in (*SPLITS, "physical"):
            continue
        states = frames.states[frames.trajectory == number]
        ways = np.append(0.0, np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T)))
        chosen = spaced(ways, apart)
        place = about["map"] if about["split"] == "physical" else "simulated"
        out.append(Drive(place, frames.folder, number, about, chosen, ways[chosen]))
    return out


def spaced(ways: NDArray[np.float64], apart: float) -> NDArray[np.intp]:
    """Choose the first place of a drive, and each that lies far enough from the last chosen.

    Args:
        ways: distance driven up to each place, (n,) [m].
        apart: least distance between two chosen places [m]; 0: all are chosen.
    """
    chosen, last = [], -np.inf
    for index, way in enumerate(ways):
        # Rounding may make the sum of steps a little smaller than it is.
        if way - last >= apart - 1e-4:
            chosen.append(index)
            last = way
    return np.array(chosen, dtype=np.intp)
