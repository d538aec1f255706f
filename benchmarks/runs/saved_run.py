"""A run that `benchmarks.corridor` has saved; its files are checked, and traces read on access."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from benchmarks.runs.drive_result import FARTHEST, DriveResult
from benchmarks.runs.moment import SHAPES
from benchmarks.runs.settings import ARMS, Settings, up_to_date
from foresee.infra.errors import LineError, one_line
from foresee.infra.plain_json import loads
from foresee.infra.resumable import UNREADABLE
from foresee.mapping.conventions import TICK
from foresee.mapping.grid import UNKNOWN, Grid, GridFrame
from foresee.mapping.polyline import arc_length

RESULTS, TRACES = "results.json", "traces.npz"
"""Names of the files of a run."""
LARGEST = 2**30
"""Largest size of an array [bytes]; a larger one is not read."""
SHOWN_FIRST = ("predicted", "oracle")
"""Arms that figures of one arm show, if a run has them."""


class RunError(LineError):
    """A folder contains no readable run; the message is one line."""


def observed_at(truth: Grid, first_seen: NDArray[np.integer], tick: int) -> Grid:
    """Return the map of what a drive has observed up to a tick, with the true values of cells.

    Args:
        truth: true map, (rows, columns).
        first_seen: array of this name of a trace, see `sim.recorder.SHAPES`, (rows, columns).
        tick: number of the tick.
    """
    seen = (first_seen > 0) & (first_seen <= tick + 1)
    return Grid(truth.frame, np.where(seen, truth.cells, np.int8(UNKNOWN)))


@dataclass(frozen=True, eq=False)
class Trace:
    """The arrays of one drive, each read on access; `SHAPES` describes them.

    Attributes:
        file: archive of the arrays.
        index: number of the episode.
        arm: name of the arm.
    """

    file: Archive
    index: int
    arm: str

    def __getitem__(self, name: str) -> NDArray[Any]:
        found = self.file.array(self._full(name))
        wanted = self._shape_of(name)
        fits = [want in ("any", size) for want, size in zip(wanted, found.shape, strict=False)]
        if len(wanted) != found.ndim or not all(fits):
            self._refuse(name, f"has shape {found.shape}, not ({', '.join(map(str, wanted))})")
        if found.dtype.kind not in ("U" if name.endswith("_names") else "biuf"):
            self._refuse(name, f"is of type {found.dtype}")
        if found.dtype.kind == "f" and not (np.abs(found.astype(np.float64)) <= FARTHEST).all():
            self._refuse(name, f"holds numbers that are not finite, or beyond {FARTHEST:g}")
        if found.size == 0 and name in ("states", "moment_plan", "moment_known", "moment_p_free"):
            self._refuse(name, "is empty")
        return found

    def __contains__(self, name: str) -> bool:
        return self._full(name) in self.file.names

    def _full(self, name: str) -> str:
        return f"e{self.index}/{self.arm}/{name}"

    def _shape_of(self, name: str) -> tuple[int | str, ...]:
        wanted = SHAPES[name]
        if wanted == "world":
            return self.file.map(self.index).shape
        if isinstance(wanted, str):
            return self[wanted].shape
        return tuple(len(self.states) - 1 if size == "T" else size for size in wanted)

    def _refuse(self, name: str, why: str) -> NoReturn:
        raise RunError(f"{self.file.path} is broken: {self._full(name)} {why}")

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """x, y [m], yaw [rad], v [m/s] at the start and at the end of each tick, (T+1, 4)."""
        return self["states"].astype(np.float64)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Distance driven up to each state [m], (T+1,)."""
        return arc_length(self.states)

    @cached_property
    def gears(self) -> NDArray[np.int8]:
        """Gear of each tick's plan, 1 or -1, (T,); always 1 in older traces."""
        return self["gears"] if "gears" in self else np.ones(len(self.states) - 1, np.int8)

    @cached_property
    def cusps(self) -> NDArray[np.int64]:
        """Numbers of the states at which the car stands and then changes its direction, (k,)."""
        moving = np.flatnonzero(self.states[:, 3])
        return moving[1:][np.diff(np.sign(self.states[moving, 3])) != 0] - 1

    @cached_property
    def limits(self) -> list[str]:
        """Name of what limited the speed in each tick, (T,)."""
        names, limits = [str(name) for name in self["limit_names"]], self["limits"].astype(int)
        if len(limits) and not 0 <= limits.min() <= limits.max() < len(names):
            self._refuse("limits", f"names none of the {len(names)} limits")
        return [names[i] for i in limits]

    @cached_property
    def relied(self) -> list[NDArray[Any]]:
        """Rows and columns of the unobserved cells that each tick's plan relies on, T of (k, 2)."""
        counts, cells = self["relied_count"].astype(int), self["relied_cells"]
        if (counts < 0).any() or counts.sum() != len(cells):
            self._refuse("relied_count", f"does not add up to the {len(cells)} cells relied on")
        return np.split(cells, np.cumsum(counts))[:-1]


@dataclass(frozen=True, eq=False)
class Archive:
    """A NumPy archive of named arrays, read one by one, or such arrays in memory.

    Attributes:
        path: path of the file.
        arrays: arrays by name, for a run that was not saved; None: they are in the file.
    """

    path: Path
    arrays: dict[str, NDArray[Any]] | None = None

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of all arrays."""
        return frozenset(self._file.files if self.arrays is None else self.arrays)

    def array(self, name: str) -> NDArray[Any]:
        """Return one array.

        Raises:
            RunError: if it is missing or broken.
        """
        if name not in self.names:
            raise RunError(f"{self.path} holds no {name!r}")
        if self.arrays is not None:
            return self.arrays[name]
        try:
            assert self._file.zip is not None
            if self._file.zip.getinfo(f"{name}.npy").file_size > LARGEST:
                raise ValueError(f"it is larger than {LARGEST} bytes")
            return np.asarray(self._file[name])
        except (*UNREADABLE, MemoryError) as error:
            raise RunError(f"{self.path} is broken at {name!r}: {one_line(error)}") from error

    def map(self, index: int) -> NDArray[np.int8]:
        """Return the cells of the true map of an episode, (rows, columns).

        Raises:
            RunError: if they are missing or broken.
        """
        cells = self.array(f"w{index}/cells")
        if cells.ndim != 2 or not cells.size or cells.dtype != np.int8:
            raise RunError(f"{self.path} is broken: w{index}/cells is no map")
        return cells

    @cached_property
    def _file(self) -> NpzFile:
        try:
            file = np.load(self.path)
        except FileNotFoundError as error:
            raise RunError(f"{self.path} does not exist") from error
        except UNREADABLE as error:
            raise RunError(f"{self.path} is broken: {one_line(error)}") from error
        if not isinstance(file, NpzFile):
            raise RunError(f"{self.path} is broken: not an archive of arrays")
        return file


def frame_of(path: Path, numbers: NDArray[Any], cells: NDArray[Any]) -> GridFrame:
    """Return the frame of a map that was read from a file.

    Args:
        path: path of the file, for error messages.
        numbers: resolution, x and y of the lower-left corner, (3,) [m].
        cells: cells of the map, (rows, columns).

    Raises:
        RunError: if the numbers cannot be those of a frame.
    """
    if (
        numbers.shape != (3,)
        or numbers.dtype.kind != "f"
        or not np.isfinite(numbers).all()
        or not 1e-3 <= numbers[0] <= 1e3
        or np.abs(numbers).max() > FARTHEST
    ):
        raise RunError(f"{path} is broken: {numbers.tolist()} is not resolution, x and y of a map")
    resolution, x, y = map(float, numbers)
    return GridFrame(resolution, (x, y), (cells.shape[0], cells.shape[1]))


@dataclass(frozen=True, eq=False)
class Run:
    """The results of a run of `benchmarks.corridor`, and its traces, which are read on access.

    Attributes:
        directory: folder of the run.
        settings: settings of the run by name.
        summary: arm → measures over all paired episodes.
        episodes: result of each drive.
        archive: archive of the traces.
    """

    directory: Path
    settings: dict[str, Any]
    summary: dict[str, dict[str, Any]]
    episodes: list[DriveResult]
    archive: Archive

    @classmethod
    def load(cls, directory: Path | str) -> Run:
        """Read the results of a folder; traces are read on access.

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
        settings, archive = up_to_date(results["settings"]), Archive(directory / TRACES)
        return cls(directory, settings, results["summary"], episodes, archive)

    @property
    def label(self) -> str:
        """Name of the run: that of its folder."""
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
        """Return the run with its first `count` episodes only, but with the summary of all."""
        kept = set(self.indices[:count])
        return replace(self, episodes=[e for e in self.episodes if e.index in kept])

    def setting(self, name: str) -> float:
        """Return a setting that is a number, or its default if the run does not name it.

        Args:
            name: field of `Settings`, or "dt", the control period.
        """
        value = self.settings.get(name)
        default = TICK if name == "dt" else getattr(Settings, name)
        return float(value if isinstance(value, int | float) else default)

    @cached_property
    def drives(self) -> dict[tuple[int, str], DriveResult]:
        """Result of each drive, by number of the episode and arm."""
        return {(episode.index, episode.arm): episode for episode in self.episodes}

    def arms_of(self, index: int) -> list[str]:
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
        arms = self.arms if index is None else self.arms_of(index)
        if arm is None:
            predicted = [n for n in arms if n in ARMS and ARMS[n].predictor != "none"]
            return next((name for name in SHOWN_FIRST if name in arms), (predicted or arms)[0])
        if arm not in arms:
            raise RunError(f"{self.directory} has no arm {arm!r} here: it has {', '.join(arms)}")
        return arm

    @cached_property
    def showcase(self) -> int:
        """Number of the first episode in which all arms reached the goal, else of the first one."""
        for index in self.indices:
            drives = [self.drives.get((index, arm)) for arm in self.arms]
            if all(drive and drive.outcome == "reached" for drive in drives):
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
        """Return the true map of an episode's building.

        Raises:
            RunError: if it is missing or broken.
        """
        cells, numbers = self.archive.map(index), self.archive.array(f"w{index}/frame")
        return Grid(frame_of(self.archive.path, numbers, cells), cells)
