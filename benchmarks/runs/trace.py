"""The arrays of a saved run, read one by one and checked."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from benchmarks.runs.drive_result import FARTHEST
from predictor.infra.errors import LineError, one_line
from predictor.mapping.grid import GridFrame

LARGEST = 2**30
"""Of an array; a larger one is refused before it is read [bytes]."""
SHAPES: dict[str, tuple[int | str, ...] | str] = {
    "states": ("any", 4),
    "controls": ("T", 2),
    "gears": ("T",),
    "plans": ("T", "any", 2),
    "limits": ("T",),
    "limit_names": ("any",),
    "emergency": ("T",),
    "unsolved": ("T",),
    "relied_count": ("T",),
    "relied_cells": ("any", 2),
    "relied_trust": ("any",),
    "kept": ("T",),
    "times": ("T", "any"),
    "time_names": ("any",),
    "moment_tick": (),
    "moment_frame": (3,),
    "moment_known": ("any", "any"),
    "moment_safe": "moment_known",
    "moment_plan": ("any", 4),
    "moment_path": ("any", 2),
    "moment_prediction_frame": (3,),
    "moment_p_free": ("any", "any"),
    "moment_p_occupied": "moment_p_free",
    "moment_confidence": "moment_p_free",
}
"""The shape of each array of a drive of T ticks, or the name of the array that has the same shape.
`first_seen` has the shape of the map."""


class RunError(LineError):
    """A folder does not hold a run that can be read; the message is one line."""


@dataclass(frozen=True, eq=False)
class Trace:
    """The arrays of one drive, each read when it is asked for; see `sim.episode.Episode`.

    Attributes:
        file: where they are.
        index: the episode's number.
        arm: who drove.
    """

    file: Archive
    index: int
    arm: str

    def __getitem__(self, name: str) -> NDArray[Any]:
        found = self._read(name)
        wanted = self._shape_of(name)
        if len(wanted) != found.ndim or any(
            isinstance(want, int) and want != size
            for want, size in zip(wanted, found.shape, strict=True)
        ):
            self._refuse(name, f"has shape {found.shape}, not ({', '.join(map(str, wanted))})")
        if found.dtype.kind not in ("U" if name.endswith("_names") else "biuf"):
            self._refuse(name, f"is of type {found.dtype}")
        if found.dtype.kind == "f" and not (np.abs(found.astype(np.float64)) <= FARTHEST).all():
            self._refuse(name, f"holds numbers that are not finite, or beyond {FARTHEST:g}")
        if found.size == 0 and name in ("states", "moment_plan", "moment_known", "moment_p_free"):
            self._refuse(name, "is empty")
        return found

    def _read(self, name: str) -> NDArray[Any]:
        return self.file.array(f"e{self.index}/{self.arm}/{name}")

    def _shape_of(self, name: str) -> tuple[int | str, ...]:
        if name == "first_seen":
            return self.file.map(self.index).shape
        wanted = SHAPES[name]
        if isinstance(wanted, str):
            return self[wanted].shape
        return tuple(len(self.states) - 1 if size == "T" else size for size in wanted)

    def _refuse(self, name: str, why: str) -> NoReturn:
        raise RunError(f"{self.file.path} is broken: e{self.index}/{self.arm}/{name} {why}")

    def __contains__(self, name: str) -> bool:
        return f"e{self.index}/{self.arm}/{name}" in self.file.names

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """x, y, yaw, v at the ends of the ticks, (T+1, 4)."""
        return self["states"].astype(np.float64)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Driven so far at each state [m], (T+1,)."""
        steps = np.hypot(*np.diff(self.states[:, :2], axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def gears(self) -> NDArray[np.int8]:
        """The gear of each tick's plan, 1 or -1, (T,); 1 throughout in older traces."""
        return self["gears"] if "gears" in self else np.ones(len(self.states) - 1, np.int8)

    @cached_property
    def cusps(self) -> NDArray[np.int64]:
        """Numbers of the states at which the car stands and then drives off the other way, (k,)."""
        moving = np.flatnonzero(self.states[:, 3])
        return moving[1:][np.diff(np.sign(self.states[moving, 3])) != 0] - 1

    @cached_property
    def limits(self) -> list[str]:
        """What limited the speed, by name, tick by tick, (T,)."""
        names, limits = [str(name) for name in self["limit_names"]], self["limits"].astype(int)
        if len(limits) and not 0 <= limits.min() <= limits.max() < len(names):
            self._refuse("limits", f"names none of the {len(names)} limits")
        return [names[i] for i in limits]

    @cached_property
    def relied(self) -> list[NDArray[Any]]:
        """Rows and columns of cells not seen that each tick's plan relies on, T of (k, 2)."""
        counts, cells = self["relied_count"].astype(int), self["relied_cells"]
        if (counts < 0).any() or counts.sum() != len(cells):
            self._refuse("relied_count", f"does not add up to the {len(cells)} cells relied on")
        return np.split(cells, np.cumsum(counts))[:-1]


@dataclass(frozen=True, eq=False)
class Archive:
    """A compressed file of named arrays.

    Attributes:
        path: where it lies.
    """

    path: Path

    @cached_property
    def names(self) -> frozenset[str]:
        """Of all arrays."""
        return frozenset(self._file.files)

    def array(self, name: str) -> NDArray[Any]:
        """Return one array.

        Raises:
            RunError: if it is missing or broken.
        """
        if name not in self.names:
            raise RunError(f"{self.path} holds no {name!r}")
        try:
            assert self._file.zip is not None
            if self._file.zip.getinfo(f"{name}.npy").file_size > LARGEST:
                raise ValueError(f"it is larger than {LARGEST} bytes")
            return np.asarray(self._file[name])
        except (
            OSError,
            ValueError,
            KeyError,
            EOFError,
            MemoryError,
            zipfile.BadZipFile,
            zlib.error,
        ) as error:
            raise RunError(f"{self.path} is broken at {name!r}: {one_line(error)}") from error

    def map(self, index: int) -> NDArray[np.int8]:
        """Cells of the true map of an episode, (rows, columns).

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
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise RunError(f"{self.path} is broken: {one_line(error)}") from error
        if not isinstance(file, NpzFile):
            raise RunError(f"{self.path} is broken: not an archive of arrays")
        return file


def frame_of(path: Path, numbers: NDArray[Any], cells: NDArray[Any]) -> GridFrame:
    """Return the frame of some cells (rows, columns) from resolution, x and y, (3,) [m].

    Args:
        path: that they were read from.
        numbers: read.
        cells: in the frame.

    Raises:
        RunError: if they are no frame.
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
