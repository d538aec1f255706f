"""A saved run: what `benchmarks.corridor` wrote into a folder, read back piece by piece."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from benchmarks.runs.arms import ARMS
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.trace import Archive, RunError, Trace, frame_of
from predictor.infra.errors import one_line
from predictor.infra.plain_json import loads
from predictor.mapping.grid import Grid

RESULTS, TRACES = "results.json", "traces.npz"
"""The files of a run."""

UNNAMED = {"vehicle": "dubins"}
"""Settings that older runs do not name, and what they were driven with."""


@dataclass(frozen=True, eq=False)
class Run:
    """A benchmark's results, and lazily its traces.

    Attributes:
        directory: where it was saved.
        settings: of the run.
        summary: arm → its measures.
        episodes: the result of each drive.
        archive: the traces.
    """

    directory: Path
    settings: dict[str, Any]
    summary: dict[str, dict[str, Any]]
    episodes: list[DriveResult]
    archive: Archive

    @classmethod
    def load(cls, directory: Path | str) -> Run:
        """Read the results of a folder; traces are read when they are needed.

        Raises:
            RunError: if the folder or its results are missing, broken, or empty.
        """
        directory = Path(directory)
        path = directory / RESULTS
        if not directory.is_dir():
            raise RunError(f"{directory} is not a folder")
        try:
            results = loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise RunError(f"{directory} holds no run: there is no {RESULTS}") from error
        except (OSError, ValueError, RecursionError) as error:
            raise RunError(f"{path} is broken: {one_line(error)}") from error
        if not isinstance(results, dict):
            raise RunError(f"{path} is broken: it must hold an object")
        for key, kind in (("settings", dict), ("summary", dict), ("episodes", list)):
            if not isinstance(results.get(key), kind):
                raise RunError(f"{path} is broken: {key!r} is missing or of the wrong kind")
        try:
            episodes = [DriveResult.from_json(episode) for episode in results["episodes"]]
        except ValueError as error:
            raise RunError(f"{path} is broken: {error}") from None
        if not episodes:
            raise RunError(f"{path} holds no episodes")
        return cls(
            directory,
            UNNAMED | results["settings"],
            results["summary"],
            episodes,
            Archive(directory / TRACES),
        )

    @property
    def label(self) -> str:
        """A short name: the folder's."""
        return self.directory.resolve().name

    @cached_property
    def arms(self) -> list[str]:
        """Arms that drove, in the order in which they are shown."""
        driven = {episode.arm for episode in self.episodes}
        return [arm for arm in ARMS if arm in driven] + sorted(driven - set(ARMS))

    @cached_property
    def indices(self) -> list[int]:
        """Numbers of the episodes, ascending."""
        return sorted({episode.index for episode in self.episodes})

    def first(self, count: int) -> Self:
        """Return the run with its first episodes alone; its summary stays that of all."""
        kept = set(self.indices[:count])
        return replace(self, episodes=[e for e in self.episodes if e.index in kept])

    def setting(self, name: str, default: float) -> float:
        """Return a setting that is a number, or the default if the run does not name it."""
        value = self.settings.get(name)
        return float(value) if isinstance(value, int | float) else default

    @cached_property
    def drives(self) -> dict[tuple[int, str], DriveResult]:
        """The result of each drive, by number of the episode and arm."""
        return {(episode.index, episode.arm): episode for episode in self.episodes}

    def arms_of(self, index: int) -> list[str]:
        """Return the arms that have driven an episode.

        Raises:
            RunError: if none has.
        """
        arms = [arm for arm in self.arms if (index, arm) in self.drives]
        if not arms:
            raise RunError(
                f"{self.directory} has no episode {index}: it has "
                + ", ".join(str(i) for i in self.indices)
            )
        return arms

    def pick_arm(self, index: int | None, arm: str | None = None) -> str:
        """Return the arm to show: the one asked for, else one that predicts.

        Args:
            index: the episode that it must have driven; None: any.
            arm: asked for.

        Raises:
            RunError: if there is no such episode, or no such arm in it.
        """
        arms = self.arms if index is None else self.arms_of(index)
        if arm is None:
            wanted = ["predicted", "oracle", "known+route", "optimistic", arms[0]]
            return next(name for name in wanted if name in arms)
        if arm not in arms:
            raise RunError(f"{self.directory} has no arm {arm!r} here: it has {', '.join(arms)}")
        return arm

    @cached_property
    def showcase(self) -> int:
        """The first episode that all arms reached the goal in, else the first of all."""
        for index in self.indices:
            drives = [self.drives.get((index, arm)) for arm in self.arms]
            if all(drive is not None and drive.outcome == "reached" for drive in drives):
                return index
        return self.indices[0]

    def trace(self, index: int, arm: str) -> Trace:
        """Return the arrays of one drive.

        Raises:
            RunError: if there are none.
        """
        trace = Trace(self.archive, index, arm)
        if "states" not in trace:
            raise RunError(f"{self.archive.path} holds no trace of episode {index}, arm {arm!r}")
        return trace

    def truth(self, index: int) -> Grid:
        """Return the true map of an episode's world.

        Raises:
            RunError: if it is missing or broken.
        """
        cells = self.archive.map(index)
        return Grid(
            frame_of(self.archive.path, self.archive.array(f"w{index}/frame"), cells), cells
        )
