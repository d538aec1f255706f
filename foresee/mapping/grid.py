"""The occupancy grid: a map of the cells that were observed free or occupied.

It follows the conventions of ROS: row = y, column = x, the origin is the lower-left corner of cell
(0, 0), and the values of cells are those of nav_msgs/OccupancyGrid.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foresee.mapping.beams import trace_beams
from foresee.mapping.body import Body, covered
from foresee.mapping.error_bounds import NO_ERRORS, ErrorBounds
from foresee.mapping.kernels import njit
from foresee.mapping.scan import Scan
from foresee.mapping.visibility import SensingBounds, mark_visible

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Cell values, as in nav_msgs/OccupancyGrid."""

HIT, MISS = 17, -8
"""Log-odds that a hit and a miss add to a cell, in steps of 0.05 (Hornung et al. 2013, OctoMap)."""
LOWEST, HIGHEST = -40, 70
"""Bounds of the log-odds, from the same source and in the same unit."""
MOST_CELLS = 10**9
"""Largest number of cells of a map that grows."""
ROUNDING = 1e-9
"""Length above all rounding errors of coordinates [m]."""


class Field(NamedTuple):
    """Values of the cells of a grid, as kernels read them.

    Attributes:
        values: value of each cell, (rows, columns).
        resolution: side of a cell [m].
        origin: x, y of the lower-left corner of cell (0, 0) [m].
    """

    values: NDArray[Any]
    resolution: float
    origin: tuple[float, float]


@dataclass(frozen=True)
class GridFrame:
    """Position, resolution and size of a grid: an axis-aligned lattice of square cells.

    Attributes:
        resolution: side of a cell [m].
        origin: x, y of the lower-left corner of cell (0, 0) [m].
        shape: rows (y), columns (x).
    """

    resolution: float
    origin: tuple[float, float]
    shape: tuple[int, int]

    @property
    def lattice(self) -> tuple[float, tuple[float, float]]:
        """Side of a cell [m], and x, y of the lower-left corner [m], as arguments of kernels."""
        return self.resolution, self.origin

    def field(self, values: NDArray[Any]) -> Field:
        """Return values of the cells (rows, columns) as a field, for kernels."""
        return Field(values, self.resolution, self.origin)

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and along y [m]."""
        return self.shape[1] * self.resolution, self.shape[0] * self.resolution

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return row and column of the cell at a point [m], which may lie outside of the grid."""
        u, v = self.in_cells(x, y)
        return math.floor(v), math.floor(u)

    def in_cells(self, x: float, y: float) -> tuple[float, float]:
        """Return the coordinates of a point [m] along the columns and along the rows [cells]."""
        return (x - self.origin[0]) / self.resolution, (y - self.origin[1]) / self.resolution

    def centre(self, row: float, col: float) -> tuple[float, float]:
        """Return the centre x, y of a cell [m]."""
        return (
            self.origin[0] + (col + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return all cell centres: x (columns,) and y (rows,) [m]."""
        rows, cols = self.shape
        x = self.origin[0] + (np.arange(cols) + 0.5) * self.resolution
        y = self.origin[1] + (np.arange(rows) + 0.5) * self.resolution
        return x.astype(np.float64), y.astype(np.float64)

    def contains(self, x: float, y: float) -> bool:
        """Return whether a point [m] lies inside the grid."""
        row, col = self.cell(x, y)
        return 0 <= row < self.shape[0] and 0 <= col < self.shape[1]

    def locate(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
        """Find the cells of points (n, 2) [m].

        Returns:
            Whether each point lies inside the grid, (n,); and row and column of the cell of each of
            the k points that do, (k,) each.
        """
        cells = np.floor((points - np.array(self.origin)) / self.resolution).astype(np.int64)
        inside = ((cells >= 0) & (cells < np.array(self.shape[::-1]))).all(axis=1)
        return inside, cells[inside, 1], cells[inside, 0]

    def offset(self, other: GridFrame) -> tuple[int, int]:
        """Return row and column of `other`'s cell (0, 0) in this frame.

        Raises:
            ValueError: if the two frames do not share one lattice.
        """
        row = (other.origin[1] - self.origin[1]) / self.resolution
        col = (other.origin[0] - self.origin[0]) / self.resolution
        on_lattice = max(abs(row - round(row)), abs(col - round(col))) < 1e-3
        if not math.isclose(self.resolution, other.resolution, rel_tol=1e-6) or not on_lattice:
            raise ValueError(f"{other} is not on the lattice of {self}: same cells are needed")
        return round(row), round(col)

    def overlap(self, other: GridFrame) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Return the cells that two frames share, as slices of this one and as slices of `other`.

        Raises:
            ValueError: if the two frames do not share one lattice.
        """
        here, there = [], []
        for start, length, their_length in zip(
            self.offset(other), self.shape, other.shape, strict=True
        ):
            low = max(0, start)
            high = max(low, min(length, start + their_length))
            here.append(slice(low, high))
            there.append(slice(low - start, high - start))
        return (here[0], here[1]), (there[0], there[1])

    def square(self, x: float, y: float, side: float) -> GridFrame:
        """Return the square of a given side [m] around a point [m], snapped to this lattice."""
        n = max(1, round(side / self.resolution))
        row = round((y - self.origin[1]) / self.resolution - n / 2)
        col = round((x - self.origin[0]) / self.resolution - n / 2)
        origin = (self.origin[0] + col * self.resolution, self.origin[1] + row * self.resolution)
        return GridFrame(self.resolution, origin, (n, n))


@dataclass(frozen=True, eq=False)
class Grid:
    """A map: cells that are FREE, OCCUPIED or UNKNOWN.

    Attributes:
        frame: position and resolution of the cells.
        cells: value of each cell, (rows, columns) int8.
    """

    frame: GridFrame
    cells: NDArray[np.int8]

    def __post_init__(self) -> None:
        if self.cells.shape != self.frame.shape:
            raise ValueError(f"cells are {self.cells.shape}, the frame says {self.frame.shape}")

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Cells observed free, (rows, columns)."""
        return np.asarray(self.cells == FREE)

    @cached_property
    def occupied(self) -> NDArray[np.bool_]:
        """Cells observed occupied, (rows, columns)."""
        return np.asarray(self.cells == OCCUPIED)

    @cached_property
    def unknown(self) -> NDArray[np.bool_]:
        """Cells not observed, (rows, columns)."""
        return np.asarray(self.cells == UNKNOWN)

    def crop(self, frame: GridFrame) -> Grid:
        """Return the part of this map inside a frame on the same lattice; outside is UNKNOWN."""
        return Grid(frame, paste(self.frame, self.cells, frame, np.int8(UNKNOWN)))


def paste(
    frame: GridFrame, values: NDArray[Any], into: GridFrame, fill: np.generic
) -> NDArray[Any]:
    """Copy the values of one frame to another frame of the same lattice.

    Args:
        frame: frame of the values.
        values: value of each cell, (rows, columns).
        into: other frame.
        fill: value of the cells of the other frame that lie outside of `frame`.
    """
    here, there = frame.overlap(into)
    out = np.full(into.shape, fill, dtype=values.dtype)
    out[there] = values[here]
    return out


def mark_beams(scan: Scan, pose: tuple[float, float, float], frame: GridFrame) -> NDArray[np.uint8]:
    """Mark the cells of a frame that the beams of a scan cross (1) and end in (2).

    Args:
        scan: scan of the LIDAR.
        pose: x, y, yaw of the robot [m, m, rad].
        frame: position and resolution of the cells.

    Returns:
        Marks (rows, columns); 0 for all other cells.
    """
    x, y, yaw = scan.sensor_pose(*pose)
    marks = np.zeros(frame.shape, dtype=np.uint8)
    trace_beams(
        marks,
        *frame.in_cells(x, y),
        yaw + scan.angle_min,
        scan.angle_increment,
        scan.ranges / frame.resolution,
        scan.range_max / frame.resolution,
    )
    return marks


def mark_sure(
    scan: Scan, pose: tuple[float, float, float], frame: GridFrame, bounds: ErrorBounds
) -> NDArray[np.uint8]:
    """Mark the cells that a scan shows to be free within bounds of error (1), or ends in (2).

    Args:
        scan: scan of the LIDAR.
        pose: estimated x, y, yaw of the robot [m, m, rad].
        frame: position and resolution of the cells.
        bounds: bounds of the errors of pose and ranges.

    Returns:
        Marks (rows, columns); 0 for all other cells.
    """
    x, y, yaw = scan.sensor_pose(*pose)
    marks = np.zeros(frame.shape, dtype=np.uint8)
    mount = math.hypot(*scan.mount[:2])
    # Beams beyond a full circle repeat the first ones.
    once = math.floor(2.0 * math.pi / abs(scan.angle_increment) + 1e-6)
    mark_visible(
        marks,
        *frame.in_cells(x, y),
        yaw + scan.angle_min,
        scan.angle_increment,
        scan.ranges[:once] / frame.resolution,
        scan.range_max / frame.resolution,
        SensingBounds(
            bounds.apart(mount) / frame.resolution, bounds.yaw, bounds.range / frame.resolution
        ),
    )
    return marks


class OccupancyGrid:
    """The map of all that a robot has observed: log-odds of occupancy, updated by scans.

    It is changed in place, unlike most values here, since copying a building's map at every tick
    would take longer than the rest of the control cycle. It grows as the robot moves.

    Args:
        frame: first extent of the map; its lattice is kept when the grid grows.
        window: side of the square around the robot inside which scans change cells [m].
    """

    def __init__(self, frame: GridFrame, window: float) -> None:
        if not window > 0:
            raise ValueError(f"window is {window} m, it must be positive")
        self.frame = frame
        self.window = window
        self.log_odds = np.zeros(frame.shape, dtype=np.int8)
        """(rows, columns) int8 in steps of 0.05; below 0 free, above 0 occupied, 0 unknown."""

    @classmethod
    def from_grid(cls, grid: Grid, window: float) -> OccupancyGrid:
        """Return a grid in which a whole map counts as observed, as for the arm `full`."""
        known = cls(grid.frame, window)
        known.log_odds[grid.free] = LOWEST
        known.log_odds[grid.occupied] = HIGHEST
        return known

    def copy(self) -> OccupancyGrid:
        """Return a copy, which later scans do not change."""
        copied = OccupancyGrid.__new__(OccupancyGrid)
        copied.frame, copied.window, copied.log_odds = self.frame, self.window, self.log_odds.copy()
        return copied

    @property
    def cells(self) -> NDArray[np.int8]:
        """Whole map as FREE, OCCUPIED, UNKNOWN: (rows, columns) int8."""
        return _classify(self.log_odds)

    def whole(self) -> Grid:
        """Return a copy of the whole observed map."""
        return Grid(self.frame, self.cells)

    def crop(self, frame: GridFrame) -> Grid:
        """Return the observed map inside a frame on this lattice."""
        return Grid(frame, _classify(paste(self.frame, self.log_odds, frame, np.int8(0))))

    def integrate(self, scan: Scan, pose: ArrayLike, bounds: ErrorBounds = NO_ERRORS) -> None:
        """Integrate a scan, taken at a robot pose (x, y, yaw), into the cells of the window.

        Each cell is updated once per scan: a cell that a beam ends in is a hit, one that a beam
        crosses is a miss. A beam with a range of NaN is ignored; one at or above `range_max` (also
        +inf) was free up to `range_max` (REP 117). If pose or ranges have errors, a cell is a miss
        only if it is free wherever in their bounds the errors lie, see `mark_visible`.

        Args:
            scan: scan of the LIDAR.
            pose: x, y, yaw of the robot, (3,) or more [m, m, rad].
            bounds: bounds of the errors of pose and ranges.

        Raises:
            ValueError: if the pose or the scan's geometry is not finite, its range not positive,
                there is no beam, or beams lie 0 rad apart.
        """
        x, y, yaw = (float(value) for value in np.asarray(pose)[:3])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            raise ValueError(f"pose is ({x}, {y}, {yaw}), it must be finite")
        if not len(scan.ranges):
            raise ValueError("the scan has no beams")
        if not scan.range_max > 0:
            raise ValueError(f"range_max is {scan.range_max} m, it must be positive")
        beams = (scan.angle_min, scan.angle_increment, *scan.mount)
        if not all(map(math.isfinite, beams)):
            raise ValueError(f"angle_min, angle_increment and mount are {beams}, not all finite")
        if scan.angle_increment == 0.0 and (len(scan.ranges) > 1 or not bounds.senses_exactly):
            raise ValueError("angle_increment is 0; only a single exact beam may have that")
        window = self.cover(self.frame.square(x, y, self.window))
        here, _ = self.frame.overlap(window)
        mark = mark_beams if bounds.senses_exactly else partial(mark_sure, bounds=bounds)
        _update(self.log_odds[here], mark(scan, (x, y, yaw), window))

    def mark_free(self, pose: ArrayLike, body: Body, around: float) -> None:
        """Mark the unobserved cells under a body as free, as at the start of a drive.

        Args:
            pose: x, y, yaw of the body [m, m, rad].
            body: the body.
            around: margin around the body that is also marked [m].
        """
        x, y, yaw = (float(value) for value in np.asarray(pose)[:3])
        # A cell whose edge the body touches counts as under it in one frame, and not in another.
        grown = body.inflated(around - ROUNDING)
        self.cover(self.frame.square(x, y, 2 * grown.radius + 2 * self.frame.resolution))
        cells = covered(self.frame.shape, *self.frame.lattice, x, y, yaw, *grown.halves)
        inside = tuple(cells.T)
        self.log_odds[inside] = np.where(self.log_odds[inside] == 0, MISS, self.log_odds[inside])

    def mark_under(self, pose: ArrayLike, body: Body, bounds: ErrorBounds = NO_ERRORS) -> None:
        """Mark the unobserved cells as free that are under a body wherever in its bounds it is.

        Args:
            pose: estimated x, y, yaw of the body [m, m, rad].
            body: the body.
            bounds: bounds of the errors of the pose.
        """
        if bounds.senses_exactly:
            self.mark_free(pose, body, 0.0)
            return
        lost = bounds.apart(body.radius) + math.sqrt(2.0) * self.frame.resolution
        if lost < min(body.halves):
            self.mark_free(pose, body.inflated(-lost), 0.0)

    def cover(self, wanted: GridFrame) -> GridFrame:
        """Grow the map, if needed, by about whole windows until a frame fits; return that frame.

        Raises:
            ValueError: if it would have more than `MOST_CELLS` cells.
        """
        # So that maps of 2, 3, 4 or 5 times coarser cells, and of cells of about 0.1 m, keep their
        # lattice.
        unit = math.lcm(60, max(1, round(0.1 / self.frame.resolution)))
        step = unit * math.ceil(max(wanted.shape[0], 100) / unit)
        missing = [
            (max(0, -start), max(0, start + length - have))
            for start, length, have in zip(
                self.frame.offset(wanted), wanted.shape, self.frame.shape, strict=True
            )
        ]
        if any(map(any, missing)):
            width = np.ceil(np.array(missing) / step).astype(int) * step
            rows, cols = (width.sum(axis=1) + self.frame.shape).tolist()
            if rows * cols > MOST_CELLS:
                raise ValueError(
                    f"the map would have {rows} x {cols} cells, at most {MOST_CELLS} are possible: "
                    "is the pose in the frame of the map?"
                )
            self.log_odds = np.pad(self.log_odds, width)
            (x, y), resolution = self.frame.origin, self.frame.resolution
            origin = (float(x - width[1, 0] * resolution), float(y - width[0, 0] * resolution))
            rows, cols = self.log_odds.shape
            self.frame = GridFrame(resolution, origin, (rows, cols))
        return wanted


@njit(cache=True, nogil=True)
def _classify(log_odds):  # type: ignore[no-untyped-def]
    """Return the values of cells by their log-odds, (rows, columns)."""
    cells = np.empty(log_odds.shape, dtype=np.int8)
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            value = log_odds[i, j]
            cells[i, j] = UNKNOWN if value == 0 else OCCUPIED if value > 0 else FREE
    return cells


@njit(cache=True, nogil=True)
def _update(log_odds, marks):  # type: ignore[no-untyped-def]
    """Add one scan's marks (0 nothing, 1 crossed, 2 hit) to log-odds, clamped, in place."""
    # Free of branches and within int8, so that it compiles to vector code.
    for row in range(marks.shape[0]):
        for col in range(marks.shape[1]):
            mark = marks[row, col]
            change = np.int8(MISS) if mark == 1 else np.int8(HIT) if mark == 2 else np.int8(0)
            value = np.int8(log_odds[row, col] + change)
            value = np.int8(HIGHEST) if value > HIGHEST else value
            log_odds[row, col] = np.int8(LOWEST) if value < LOWEST else value


def world_hash(cells: NDArray[np.int8]) -> str:
    """Return a hash of a building's cells, which identifies the building in splits of data."""
    digest = hashlib.sha256(np.array(cells.shape, dtype=np.int64).tobytes())
    digest.update(np.ascontiguousarray(cells).tobytes())
    return digest.hexdigest()[:32]
