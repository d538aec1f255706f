"""A planar LIDAR, exact against the grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from predictor.grid import OCCUPIED
from predictor.scan import Scan
from sim.world import World


@dataclass(frozen=True)
class LidarConfig:
    """A LIDAR and how it is mounted; the defaults are the paper's (Hokuyo-like).

    Attributes:
        fov: field of view, centred on the sensor's heading [rad].
        beams: rays a scan.
        range_max: longest range that returns [m].
        mount: x, y, yaw of the sensor in the robot's frame [m, m, rad].
        range_noise: standard deviation of a return's range [m].
        dropout: share of beams that come back as NaN, in [0, 1].
    """

    fov: float = math.radians(270.0)
    beams: int = 1081
    range_max: float = 20.0
    mount: tuple[float, float, float] = (0.1, 0.0, 0.0)
    range_noise: float = 0.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.fov <= 2 * math.pi + 1e-9:
            raise ValueError(f"fov is {self.fov} rad, it must lie in (0, 2π]")
        if self.beams < 2:
            raise ValueError(f"beams is {self.beams}, at least 2 are needed")
        if not 0 < self.range_max < math.inf:
            raise ValueError(f"range_max is {self.range_max} m, it must be positive and finite")
        if not 0 <= self.range_noise < math.inf:
            raise ValueError(f"range_noise is {self.range_noise} m, it may not be negative")
        if not 0 <= self.dropout <= 1:
            raise ValueError(f"dropout is {self.dropout}, it must lie in [0, 1]")

    @property
    def angle_min(self) -> float:
        """Direction of beam 0 in the sensor's frame [rad]."""
        return -0.5 * self.fov

    @property
    def angle_increment(self) -> float:
        """Angle from one beam to the next [rad]; a full circle does not repeat its first beam."""
        full = self.fov >= 2 * math.pi - 1e-9
        return self.fov / (self.beams if full else self.beams - 1)


class Lidar:
    """Takes scans of a world.

    Args:
        config: the sensor.
    """

    def __init__(self, config: LidarConfig | None = None) -> None:
        self.config = config or LidarConfig()
        angles = self.config.angle_min + np.arange(self.config.beams) * self.config.angle_increment
        self._beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def scan(
        self,
        world: World,
        pose: ArrayLike,
        rng: np.random.Generator | None = None,
        discs: NDArray[np.float64] | None = None,
    ) -> Scan:
        """One scan from a robot pose (x, y, yaw).

        A return has the range at which the beam enters an OCCUPIED cell or a disc. +inf: nothing
        within range. NaN: the beam ran into UNKNOWN or out of the map, dropped out, or began in a
        wall.

        Args:
            world: what is looked at.
            pose: x, y, yaw of the robot [m, m, rad]; further entries are not read.
            rng: source of noise and dropout.
            discs: x, y, radius of round things that stand in free space, (n, 3) [m]. A beam that
                would be NaN without them stays NaN.

        Raises:
            ValueError: if the sensor is noisy and `rng` is missing, or the pose is not finite.
        """
        config = self.config
        x, y, yaw = (float(value) for value in np.asarray(pose, dtype=np.float64)[:3])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            raise ValueError(f"pose is ({x}, {y}, {yaw}), it must be finite")
        blank = Scan(np.empty(0), config.angle_min, config.angle_increment, config.range_max,
                     config.mount)  # fmt: skip
        sx, sy, bearing = blank.sensor_pose(x, y, yaw)
        frame = world.grid.frame
        ranges = frame.resolution * cast_rays(
            world.skips,
            world.grid.cells,
            (sx - frame.origin[0]) / frame.resolution,
            (sy - frame.origin[1]) / frame.resolution,
            bearing,
            self._beams,
            config.range_max / frame.resolution,
        )
        if discs is not None and len(discs):
            ranges = self._blocked(ranges, (sx, sy, bearing), discs)
        if config.range_noise or config.dropout:
            if rng is None:
                raise ValueError("a sensor with noise or dropout needs an rng")
            ranges = self._disturbed(ranges, rng)
        return Scan(ranges, config.angle_min, config.angle_increment, config.range_max,
                    config.mount)  # fmt: skip

    def _blocked(
        self,
        ranges: NDArray[np.float64],
        sensor: tuple[float, float, float],
        discs: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """The ranges [m] where discs stand before what the beams would meet."""
        x, y, bearing = sensor
        cos, sin = math.cos(bearing), math.sin(bearing)
        to_x, to_y = discs[:, 0] - x, discs[:, 1] - y
        # In the sensor's frame, (discs, beams): along each beam, and the square across it.
        ahead = np.column_stack([cos * to_x + sin * to_y, cos * to_y - sin * to_x]) @ self._beams.T
        half = discs[:, 2, None] ** 2 - (to_x**2 + to_y**2)[:, None] + ahead**2
        met = (half > 0) & (ahead > 0)
        entry = np.where(met, ahead - np.sqrt(np.where(met, half, 0.0)), np.inf).min(axis=0)
        entry = np.maximum(entry, 0.0)
        # NaN stays: it is not known how far such a beam came.
        return np.where(entry < self.config.range_max, np.minimum(ranges, entry), ranges)

    def _disturbed(
        self, ranges: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        # Both are drawn for every beam, so that what one beam meets does not shift the others.
        noise = rng.normal(0.0, self.config.range_noise, ranges.shape)
        dropped = rng.random(ranges.shape) < self.config.dropout
        # A return stays a return: noise never turns it into "nothing within range".
        longest = np.nextafter(self.config.range_max, 0.0)
        noisy = np.where(np.isfinite(ranges), np.clip(ranges + noise, 0.0, longest), ranges)
        return np.where(dropped, np.nan, noisy)


@njit(cache=True, nogil=True)
def cast_rays(skips, cells, x, y, bearing, beams, longest):  # type: ignore[no-untyped-def]
    """Range along each beam to the first OCCUPIED cell [cells], exact.

    Each step crosses the whole empty square ahead in the ray's quadrant, then enters one cell
    through an edge of it. Where a ray runs exactly through a corner it steps along one axis at a
    time, so the cells it visits always share edges and no diagonal wall lets it pass.

    Args:
        skips: `empty_squares` of the map, (4, rows + 2, columns + 2) uint8.
        cells: (rows, columns) int8.
        x: position along the columns [cells].
        y: position along the rows [cells].
        bearing: the sensor's yaw [rad].
        beams: (n, 2) unit vectors in the sensor's frame.
        longest: the sensor's range [cells].

    Returns:
        (n,) [cells]; +inf: nothing within `longest`; NaN: UNKNOWN, or outside, came first, or the
        beam begins in a solid cell.
    """
    rows, cols = cells.shape
    out = np.full(beams.shape[0], np.nan)
    if not (0.0 <= x < cols and 0.0 <= y < rows):
        return out
    cos, sin = math.cos(bearing), math.sin(bearing)
    x += 1.0
    y += 1.0
    start_row, start_col = int(y), int(x)
    if skips[0, start_row, start_col] == 0:
        return out
    for beam in range(beams.shape[0]):
        dx = cos * beams[beam, 0] - sin * beams[beam, 1]
        dy = sin * beams[beam, 0] + cos * beams[beam, 1]
        # A direction this close to an axis would overflow its inverse, and strays less than 1e-9.
        if abs(dx) < 1e-13:
            dx = 0.0
        if abs(dy) < 1e-13:
            dy = 0.0
        left, down = dx < 0.0, dy < 0.0
        inv_x = 1.0 / dx if dx != 0.0 else 1e300
        inv_y = 1.0 / dy if dy != 0.0 else 1e300
        step_x, step_y = -1 if left else 1, -1 if down else 1
        # Moving down an axis, a cell is entered through its upper edge.
        edge_x, edge_y = x - (1.0 if left else 0.0), y - (1.0 if down else 0.0)
        plane = skips[2 * down + left]
        row, col = start_row, start_col
        side = int(plane[row, col])
        travelled = 0.0
        while side:
            past_col, past_row = col + step_x * side, row + step_y * side
            to_x, to_y = (past_col - edge_x) * inv_x, (past_row - edge_y) * inv_y
            if to_x <= to_y:
                travelled = to_x
                across = int(y + to_x * dy)
                # Rounding may not move the ray off the square's own edge.
                if down:
                    row = max(past_row + 1, min(across, row))
                else:
                    row = min(past_row - 1, max(across, row))
                col = past_col
            else:
                travelled = to_y
                across = int(x + to_y * dx)
                if left:
                    col = max(past_col + 1, min(across, col))
                else:
                    col = min(past_col - 1, max(across, col))
                row = past_row
            if travelled >= longest:
                break
            side = int(plane[row, col])
        if travelled >= longest:
            out[beam] = np.inf
        elif 1 <= row <= rows and 1 <= col <= cols and cells[row - 1, col - 1] == OCCUPIED:
            out[beam] = travelled
    return out
