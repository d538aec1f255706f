"""The trace of a drive: its arrays and those of its building, each checked when it is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.beliefs import BLOCK, CERTAIN
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.moment import SHAPES
from foresee.infra.errors import LineError
from foresee.infra.plain_json import FARTHEST
from foresee.mapping.grid import UNKNOWN, Grid, GridFrame
from foresee.mapping.polyline import arc_length
from sim.task import Task


class RunError(LineError):
    """A folder contains no readable run; the message is one line."""


@dataclass(frozen=True, eq=False)
class RecordedMoment:
    """One tick of a drive in full.

    Attributes:
        tick: number of the tick.
        known: observed map around the car.
        safe: cells that the plan may enter, (rows, columns).
        plan: states of the plan: x, y, yaw, v, (N + 1, 4).
        path: points of the reference path, (n, 2) [m].
        prediction: p_free, p_occupied and confidence of each cell; None: there is no prediction.
        frame: frame of the prediction; without one, the frame of `known`.
    """

    tick: int
    known: Grid
    safe: NDArray[np.bool_]
    plan: NDArray[np.float64]
    path: NDArray[np.float64]
    prediction: list[NDArray[np.float64]] | None
    frame: GridFrame


def _recorded(name: str) -> cached_property[NDArray[Any]]:
    """Return the property that reads an array of a trace."""
    return cached_property(lambda trace: trace.read(name))


@dataclass(frozen=True, eq=False)
class Trace:
    """The arrays of one drive, each read on access; RunError is raised if it is missing or broken.

    Attributes:
        path: file that holds the arrays, for error messages.
        index: number of the episode.
        arm: name of the arm.
        arrays: arrays by name, such as "e0/known/states" and "w0/cells"; there may be those of
            other drives as well.
    """

    path: Path
    index: int
    arm: str
    arrays: Mapping[str, NDArray[Any]]

    # `benchmarks.runs.moment.SHAPES` describes these arrays.
    controls = _recorded("controls")
    plans = _recorded("plans")
    relied_count = _recorded("relied_count")
    kept = _recorded("kept")
    first_seen = _recorded("first_seen")

    @classmethod
    def of(cls, task: Task, index: int, arm: str, recorded: Mapping[str, NDArray[Any]]) -> Trace:
        """Return the trace of a drive of this process from what `sim.recorder` has recorded."""
        grid = task.world.grid
        arrays = {f"e{index}/{arm}/{name}": values for name, values in recorded.items()}
        arrays[f"w{index}/cells"] = grid.cells
        arrays[f"w{index}/frame"] = np.array([grid.frame.resolution, *grid.frame.origin])
        arrays[f"w{index}/waypoints"] = task.waypoints
        return cls(Path(task.world.name), index, arm, arrays)

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """x, y [m], yaw [rad], v [m/s] at the start and at the end of each tick, (T+1, 4)."""
        return np.asarray(self.read("states"), dtype=np.float64)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Distance driven up to each state [m], (T+1,)."""
        return arc_length(self.states)

    @cached_property
    def gears(self) -> NDArray[np.int8]:
        """Gear of each tick's plan, 1 or -1, (T,); always 1 in older traces."""
        return self.read("gears") if "gears" in self else np.ones(len(self.states) - 1, np.int8)

    @cached_property
    def cusps(self) -> NDArray[np.int64]:
        """Numbers of the states at which the car stands and then changes its direction, (k,)."""
        moving = np.flatnonzero(self.states[:, 3])
        return moving[1:][np.diff(np.sign(self.states[moving, 3])) != 0] - 1

    @cached_property
    def limits(self) -> list[str]:
        """Name of what limited the speed in each tick, (T,)."""
        names, limits = self.read("limit_names").tolist(), self.read("limits").astype(int)
        if len(limits) and not 0 <= limits.min() <= limits.max() < len(names):
            self._refuse("limits", f"names none of the {len(names)} limits")
        return [names[i] for i in limits]

    @cached_property
    def relied(self) -> list[NDArray[Any]]:
        """Rows and columns of the unobserved cells that each tick's plan relies on, T of (k, 2)."""
        counts, cells = self.relied_count.astype(int), self.read("relied_cells")
        if (counts < 0).any() or counts.sum() != len(cells):
            self._refuse("relied_count", f"does not add up to the {len(cells)} cells relied on")
        return np.split(cells, np.cumsum(counts))[:-1]

    def stage_times(self, first: int = 0) -> dict[str, NDArray[np.float32]]:
        """Return the durations of each stage of the control cycle, (k,) [ms].

        Args:
            first: first tick that is counted. Ticks in which the stage did not run are not.
        """
        names, times = self.read("time_names").tolist(), self.read("times")
        if times.shape[1] != len(names):
            self._refuse("times", f"has {times.shape[1]} stages, not {len(names)}")
        counted = zip(names, times[first:].T, strict=True)
        return {name: taken[taken > 0.0] for name, taken in counted}

    @cached_property
    def truth(self) -> Grid:
        """True map of the building."""
        return Grid(self._frame(f"w{self.index}/frame", self._cells), self._cells)

    @property
    def waypoints(self) -> NDArray[np.float64]:
        """Points of the prescribed route, at least one, (n, 2) [m]."""
        name = f"w{self.index}/waypoints"
        points = self._array(name)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise RunError(f"{self.path} is broken: {name} has shape {points.shape}, not (n, 2)")
        if points.dtype.kind != "f" or not (np.abs(points) <= FARTHEST).all():
            raise RunError(f"{self.path} is broken: {name} holds no finite numbers")
        return points

    def observed(self, tick: int) -> Grid:
        """Return the map of what was observed up to a tick, with the true values of cells."""
        seen = (self.first_seen > 0) & (self.first_seen <= tick + 1)
        return Grid(self.truth.frame, np.where(seen, self.truth.cells, np.int8(UNKNOWN)))

    def belief(self, tick: int) -> tuple[NDArray[np.float64], GridFrame] | None:
        """Return what the predictor expected in a tick, from -1, occupied, to 1, free.

        Returns:
            The belief in each coarse cell, (rows, columns), see `benchmarks.runs.beliefs.Beliefs`,
            and the frame of these cells; None if none was recorded.
        """
        if "beliefs" not in self:
            return None
        cells, corner = self.read("beliefs")[tick], self.read("belief_corners")[tick].astype(float)
        side = BLOCK * self.truth.frame.resolution
        x, y = self.truth.frame.origin
        origin = x + side * corner[1], y + side * corner[0]
        return cells / CERTAIN, GridFrame(side, origin, (cells.shape[0], cells.shape[1]))

    @property
    def moment(self) -> RecordedMoment:
        """The tick that was recorded in full."""
        known = self.read("moment_known")
        prediction, frame = None, self._frame(self._full("moment_frame"), known)
        other = frame
        if "moment_p_free" in self:
            names = ("moment_p_free", "moment_p_occupied", "moment_confidence")
            prediction = [self.read(name) / 255.0 for name in names]
            other = self._frame(self._full("moment_prediction_frame"), prediction[0])
        return RecordedMoment(
            int(self.read("moment_tick")),
            Grid(frame, known),
            self.read("moment_safe").astype(bool),
            self.read("moment_plan").astype(np.float64),
            self.read("moment_path").astype(np.float64),
            prediction,
            other,
        )

    def check(self, names: Iterable[str]) -> None:
        """Read and check some arrays of this drive and its building, given by their full names.

        Raises:
            RunError: if one is missing or broken, or there are no states or no map.
        """
        own = self._full("")
        for full_name in names:
            if full_name.removeprefix(own) in SHAPES:
                self.read(full_name.removeprefix(own))
            else:
                self._array(full_name)
        self.read("states")
        self._frame(f"w{self.index}/frame", self._cells)

    def __contains__(self, name: str) -> bool:
        return self._full(name) in self.arrays

    def read(self, name: str) -> NDArray[Any]:
        """Return an array of `benchmarks.runs.moment.SHAPES`, checked.

        Raises:
            RunError: if it is missing or broken.
        """
        array, wanted = self._array(self._full(name)), self._expected_shape(name)
        fits = [want in ("any", size) for want, size in zip(wanted, array.shape, strict=False)]
        if len(wanted) != array.ndim or not all(fits):
            self._refuse(name, f"has shape {array.shape}, not ({', '.join(map(str, wanted))})")
        if array.dtype.kind not in ("U" if name.endswith("_names") else "biuf"):
            self._refuse(name, f"is of type {array.dtype}")
        if array.dtype.kind == "f" and not (np.abs(array.astype(np.float64)) <= FARTHEST).all():
            self._refuse(name, f"holds numbers that are not finite, or beyond {FARTHEST:g}")
        if array.size == 0 and name in ("states", "moment_plan", "moment_known", "moment_p_free"):
            self._refuse(name, "is empty")
        return array

    @cached_property
    def _cells(self) -> NDArray[np.int8]:
        cells = self._array(f"w{self.index}/cells")
        if cells.ndim != 2 or not cells.size or cells.dtype != np.int8:
            raise RunError(f"{self.path} is broken: w{self.index}/cells is no map")
        return cells

    def _array(self, full_name: str) -> NDArray[Any]:
        if full_name not in self.arrays:
            raise RunError(f"{self.path} holds no {full_name!r}")
        return self.arrays[full_name]

    def _full(self, name: str) -> str:
        return f"e{self.index}/{self.arm}/{name}"

    def _expected_shape(self, name: str) -> tuple[int | str, ...]:
        wanted = SHAPES[name]
        if wanted == "world":
            return self._cells.shape
        if isinstance(wanted, str):
            return self.read(wanted).shape
        return tuple(len(self.states) - 1 if size == "T" else size for size in wanted)

    def _frame(self, full_name: str, cells: NDArray[Any]) -> GridFrame:
        """Return the frame of a map: an array holds its resolution, and x and y of its origin."""
        numbers = self._array(full_name)
        if (
            numbers.shape != (3,)
            or numbers.dtype.kind != "f"
            or not np.isfinite(numbers).all()
            or not 1e-3 <= numbers[0] <= 1e3
            or np.abs(numbers).max() > FARTHEST
        ):
            raise RunError(
                f"{self.path} is broken: {full_name} is {numbers.tolist()}, not resolution, x and y"
            )
        resolution, x, y = map(float, numbers)
        return GridFrame(resolution, (x, y), (cells.shape[0], cells.shape[1]))

    def _refuse(self, name: str, why: str) -> NoReturn:
        raise RunError(f"{self.path} is broken: {self._full(name)} {why}")


class Drive(NamedTuple):
    """A drive: its result, an entry of results.json, and its trace, arrays of traces.npz."""

    result: DriveResult
    trace: Trace
