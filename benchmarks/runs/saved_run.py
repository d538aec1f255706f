"""A run that `benchmarks.corridor` has saved; its files are checked, and traces read on access."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from numpy.typing import NDArray

from benchmarks.runs.arms import ARMS, arm_kind
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import Settings, checked, up_to_date
from benchmarks.runs.trace import RunError, Trace
from foresee.infra.errors import one_line
from foresee.infra.plain_json import read_object
from foresee.infra.plain_npz import NpzError, PlainNpz
from foresee.infra.results_file import MOST_BYTES
from foresee.mapping.body import Body
from foresee.mapping.conventions import TICK

RESULTS, TRACES = "results.json", "traces.npz"
"""Names of the files of a run."""
LARGEST = 2**28
"""Largest size of an array [bytes]; a larger one is not read. Those of the largest map that is
read have half of it."""
SHOWN_FIRST = ("predicted", "oracle")
"""Kinds of arms that figures of one arm show, if a run has them."""


@dataclass(frozen=True, eq=False)
class Archive(Mapping[str, NDArray[Any]]):
    """The arrays of a NumPy archive, which are read one by one.

    Attributes:
        path: path of the file.
    """

    path: Path

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one array.

        Raises:
            RunError: if it is missing or broken.
        """
        if name not in self:
            raise RunError(f"{self.path} holds no {name!r}")
        try:
            return self._file.read(name, LARGEST)
        except (OSError, NpzError) as error:
            raise RunError(f"{self.path} is broken: {one_line(error)}") from error

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @cached_property
    def groups(self) -> dict[str, list[str]]:
        """Drive or building, such as "e0/known" or "w0" → full names of its arrays."""
        groups: dict[str, list[str]] = {}
        for name in self:
            groups.setdefault(name.rpartition("/")[0], []).append(name)
        return groups

    @cached_property
    def _names(self) -> dict[str, None]:
        return dict.fromkeys(self._file.names)

    @cached_property
    def _file(self) -> PlainNpz:
        try:
            return PlainNpz(self.path)
        except FileNotFoundError as error:
            raise RunError(f"{self.path} does not exist") from error
        except (OSError, NpzError) as error:
            raise RunError(f"{self.path} is broken: {one_line(error)}") from error


@dataclass(frozen=True, eq=False)
class Run:
    """The results of a run of `benchmarks.corridor`, and its traces, which are read on access.

    Attributes:
        directory: folder of the run.
        settings: settings of the run by name.
        summary: arm → measures over all paired episodes.
        episodes: result of each drive.
        arrays: arrays of all drives and buildings by name.
        unused: results of further drives, which the settings do not ask for any more.
        skipped: number of an episode → reason why it has no task.
    """

    directory: Path
    settings: dict[str, Any]
    summary: dict[str, dict[str, Any]]
    episodes: list[DriveResult]
    arrays: Mapping[str, NDArray[Any]]
    unused: list[DriveResult] = field(default_factory=list)
    skipped: dict[int, str] = field(default_factory=dict)

    @classmethod
    def load(cls, directory: Path | str) -> Run:
        """Read the results of a folder with drives; traces are read on access.

        Raises:
            RunError: if the folder or its results are missing, broken, or empty.
        """
        run = cls.read(Path(directory))
        if not run.episodes:
            raise RunError(f"{run.directory / RESULTS} holds no episodes")
        return run

    @classmethod
    def read(cls, directory: Path) -> Run:
        """Read the results of a folder, which may hold no drive.

        Raises:
            RunError: if the folder or its results are missing or broken.
        """
        path = directory / RESULTS
        if not directory.is_dir():
            raise RunError(f"{directory} is not a folder")
        try:
            results = {"unused": [], "skipped": {}} | read_object(path, MOST_BYTES)
            for key in ("settings", "summary", "skipped"):
                if not isinstance(results[key], dict):
                    raise ValueError(f"{key!r} must be an object")
            settings = checked(up_to_date(results["settings"]))
            drives, unused = (
                [DriveResult.from_json(drive) for drive in results[key]]
                for key in ("episodes", "unused")
            )
            skipped = {int(index): str(why) for index, why in results["skipped"].items()}
        except FileNotFoundError as error:
            raise RunError(f"{directory} holds no run: there is no {RESULTS}") from error
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise RunError(f"{path} is broken: {one_line(error)}") from error
        arrays = Archive(directory / TRACES)
        return cls(directory, settings, results["summary"], drives, arrays, unused, skipped)

    @property
    def label(self) -> str:
        """Name of the run: that of its folder."""
        return self.directory.resolve().name

    @cached_property
    def arms(self) -> list[str]:
        """Arms that drove, in the order in which they are shown."""
        driven = dict.fromkeys(episode.arm for episode in self.episodes)
        order = {arm: place for place, arm in enumerate(ARMS)}
        return sorted(driven, key=lambda arm: order.get(arm_kind(arm), len(order)))

    @cached_property
    def indices(self) -> list[int]:
        """Numbers of the episodes, ascending."""
        return sorted({episode.index for episode in self.episodes})

    def first(self, count: int) -> Self:
        """Return the run with its first `count` episodes only, but with the summary of all."""
        kept = set(self.indices[:count])
        return replace(self, episodes=[e for e in self.episodes if e.index in kept])

    def setting(self, name: str) -> float:
        """Return a setting that is a number, or its default if the run does not name it.

        Args:
            name: field of `Settings`, or "dt", the control period.
        """
        return float(self.settings.get(name, TICK if name == "dt" else getattr(Settings, name)))

    @property
    def body(self) -> Body:
        """Body of the car."""
        return Body(self.setting("length"), self.setting("width"))

    @cached_property
    def drives(self) -> dict[tuple[int, str], DriveResult]:
        """Result of each drive, by number of the episode and arm."""
        return {(episode.index, episode.arm): episode for episode in self.episodes}

    def driven_arms(self, index: int) -> list[str]:
        """Return the arms that have driven an episode.

        Raises:
            RunError: if none has.
        """
        arms = [arm for arm in self.arms if (index, arm) in self.drives]
        if not arms:
            has = ", ".join(map(str, self.indices))
            raise RunError(f"{self.directory} has no episode {index}: it has {has}")
        return arms

    def pick_arm(self, index: int | None, arm: str | None = None) -> str:
        """Return the arm to show: the one asked for, else one that uses a prediction.

        Args:
            index: number of an episode that the arm must have driven; None: any.
            arm: arm that is asked for; None: choose one.

        Raises:
            RunError: if there is no such episode, or no such arm in it.
        """
        arms = self.arms if index is None else self.driven_arms(index)
        if arm is None:
            first = [name for kind in SHOWN_FIRST for name in arms if arm_kind(name) == kind]
            return [*first, *(name for name in arms if self._predicts(name)), *arms][0]
        if arm not in arms:
            raise RunError(f"{self.directory} has no arm {arm!r} here: it has {', '.join(arms)}")
        return arm

    @staticmethod
    def _predicts(arm: str) -> bool:
        kind = arm_kind(arm)
        return kind in ARMS and ARMS[kind].predictor != "none"

    @cached_property
    def showcase(self) -> int:
        """Number of the first episode in which all arms reached the goal, else of the first one."""
        for index in self.indices:
            drives = [self.drives.get((index, arm)) for arm in self.arms]
            if all(drive and drive.outcome == "reached" for drive in drives):
                return index
        return self.indices[0]

    def trace(self, index: int, arm: str) -> Trace:
        """Return the trace of a drive, whose arrays are read on access."""
        return Trace(self.directory / TRACES, index, arm, self.arrays)
