"""The simulated planar LIDAR, whose ranges are exact on the grid of the true map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foresee.mapping.conventions import NOISE_CUT
from foresee.mapping.grid import OCCUPIED
from foresee.mapping.kernels import njit
from foresee.mapping.scan import Scan
from sim.world import World


@dataclass(frozen=True)
class LidarConfig:
    """Settings of a LIDAR (by default Hokuyo-like, as in Katyal et al. 2018) and of its mount.

    Attributes:
        fov: field of view, centred on the sensor's heading [rad].
        beams: number of beams of a scan.
        range_max: longest range that is measured [m].
        mount: x, y, yaw of the sensor in the robot's frame [m, m, rad].
        range_noise: standard deviation of the noise of a range, which is cut off at three times as
            much [m].
        dropout: probability that a beam drops out, with a range of NaN, in [0, 1].
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
        config: settings of the LIDAR; None: the defaults.
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
        """Take a scan from a robot pose (x, y, yaw).

        The range of a beam is the distance at which it enters an OCCUPIED cell or a disc. +inf:
        nothing is within range. NaN: the beam entered an UNKNOWN cell or left the map, dropped out,
        or began in a wall.

        Args:
            world: building in which the robot is.
            pose: x, y, yaw of the robot [m, m, rad]; further entries are ignored.
            rng: source of noise and dropouts.
            discs: x, y, radius of round objects in free space, such as people, (n, 3) [m]. A beam
                that is NaN without them stays NaN.

        Raises:
            ValueError: if the sensor is noisy and `rng` is missing, or the pose is not finite.
        """
        config = self.config
        x, y, yaw = (float(value) for value in np.asarray(pose, dtype=np.float64)[:3])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
            raise ValueError(f"pose is ({x}, {y}, {yaw}), it must be finite")
        blank = Scan(
            np.empty(0), config.angle_min, config.angle_increment, config.range_max, config.mount
        )
        sx, sy, bearing = blank.sensor_pose(x, y, yaw)
        frame = world.grid.frame
        place, longest = frame.in_cells(sx, sy), config.range_max / frame.resolution
        ranges = frame.resolution * cast_rays(
            world.skips, world.grid.cells, *place, bearing, self._beams, longest
        )
        if discs is not None and len(discs):
            ranges = self._blocked(ranges, (sx, sy, bearing), discs)
        if config.range_noise or config.dropout:
            if rng is None:
                raise ValueError("a sensor with noise or dropout needs an rng")
            ranges = self._disturbed(ranges, rng)
        return replace(blank, ranges=ranges)

    def _blocked(
        self,
        ranges: NDArray[np.float64],
        sensor: tuple[float, float, float],
        discs: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the ranges [m] of beams that discs may block."""
        x, y, bearing = sensor
        cos, sin = math.cos(bearing), math.sin(bearing)
        to_x, to_y = discs[:, 0] - x, discs[:, 1] - y
        # (discs, beams): distance of a disc's centre along a beam, and square of half the chord
        # that the disc cuts out of it.
        ahead = np.column_stack([cos * to_x + sin * to_y, cos * to_y - sin * to_x]) @ self._beams.T
        half = discs[:, 2, None] ** 2 - (to_x**2 + to_y**2)[:, None] + ahead**2
        met = (half > 0) & (ahead > 0)
        entry = np.where(met, ahead - np.sqrt(np.where(met, half, 0.0)), np.inf).min(axis=0)
        entry = np.maximum(entry, 0.0)
        # NaN stays NaN, since it is not known how far such a beam came.
        return np.where(entry < self.config.range_max, np.minimum(ranges, entry), ranges)

    def _disturbed(
        self, ranges: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the ranges with noise, and NaN where a beam dropped out."""
        # Both are drawn for every beam, so that no beam's draw depends on what another beam meets.
        noise = self.config.range_noise * rng.normal(size=ranges.shape).clip(-NOISE_CUT, NOISE_CUT)
        dropped = rng.random(ranges.shape) < self.config.dropout
        # Noise never turns a range into "nothing within range".
        longest = np.nextafter(self.config.range_max, 0.0)
        noisy = np.where(np.isfinite(ranges), np.clip(ranges + noise, 0.0, longest), ranges)
        return np.where(dropped, np.nan, noisy)


LANES = 4
"""Number of beams that are followed at a time: while one waits for memory, the others go on."""


@njit(cache=True, nogil=True)
def cast_rays(skips, cells, x, y, bearing, beams, longest):  # type: ignore[no-untyped-def]
    """Compute the exact range along each beam to the first OCCUPIED cell [cells].

    Each step crosses the whole empty square ahead in the ray's quadrant, then enters one cell
    through an edge of it. Where a ray runs exactly through a corner it steps along one axis at a
    time, so the cells it visits always share edges and no diagonal wall lets it pass.

    Args:
        skips: `empty_squares` of the map, (4, rows + 2, columns + 2) uint8, contiguous.
        cells: cells of the map, (rows, columns) int8.
        x: position of the sensor along the columns [cells].
        y: position of the sensor along the rows [cells].
        bearing: yaw of the sensor [rad].
        beams: unit vectors of the beams in the sensor's frame, (n, 2).
        longest: longest range of the sensor [cells].

    Returns:
        Ranges of the beams, (n,) [cells]; +inf: nothing is within `longest`; NaN: the beam entered
        an UNKNOWN cell or left the map, or it begins in a solid cell.
    """
    rows, cols = cells.shape
    count = beams.shape[0]
    out = np.full(count, np.nan)
    if not (0.0 <= x < cols and 0.0 <= y < rows):
        return out
    cos, sin = math.cos(bearing), math.sin(bearing)
    x += 1.0
    y += 1.0
    wide = cols + 2
    squares = skips.reshape(-1)
    start = int(y) * wide + int(x)
    if squares[start] == 0:
        return out
    # For the beam of each lane: its number, its direction, the inverse and the signs of the
    # direction, the coordinates from which the edges that it crosses are measured, the plane of its
    # quadrant, the cell that it is in, and the side of the empty square ahead. The side is 0 where
    # the beam has ended and the lane is free.
    beam = np.empty(LANES, dtype=np.int64)
    dx, dy, inv_x, inv_y = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    step_x, step_y = np.empty(LANES, dtype=np.int64), np.empty(LANES, dtype=np.int64)
    edge_x, edge_y = np.empty(LANES), np.empty(LANES)
    plane = np.empty(LANES, dtype=np.int64)
    row, col = np.empty(LANES, dtype=np.int64), np.empty(LANES, dtype=np.int64)
    ahead = np.zeros(LANES, dtype=np.int64)
    begun = ended = 0
    while ended < count:
        for i in range(LANES):
            if ahead[i] == 0:
                if begun == count:
                    continue
                dx[i] = cos * beams[begun, 0] - sin * beams[begun, 1]
                dy[i] = sin * beams[begun, 0] + cos * beams[begun, 1]
                # A component this small is a rounding error; the ray strays by less than 1e-9.
                if abs(dx[i]) < 1e-13:
                    dx[i] = 0.0
                if abs(dy[i]) < 1e-13:
                    dy[i] = 0.0
                inv_x[i] = 1.0 / dx[i] if dx[i] != 0.0 else 1e300
                inv_y[i] = 1.0 / dy[i] if dy[i] != 0.0 else 1e300
                left, down = dx[i] < 0.0, dy[i] < 0.0
                step_x[i], step_y[i] = -1 if left else 1, -1 if down else 1
                # Moving down an axis, a cell is entered through its upper edge.
                edge_x[i], edge_y[i] = x - (1.0 if left else 0.0), y - (1.0 if down else 0.0)
                plane[i] = (2 * down + left) * (rows + 2) * wide
                row[i], col[i] = int(y), int(x)
                ahead[i] = squares[plane[i] + start]
                beam[i] = begun
                begun += 1
            # Without branches, which the processor could not predict: compute where the ray
            # leaves the square along x and along y, and take what comes first.
            past_col, past_row = col[i] + step_x[i] * ahead[i], row[i] + step_y[i] * ahead[i]
            to_x, to_y = (past_col - edge_x[i]) * inv_x[i], (past_row - edge_y[i]) * inv_y[i]
            through_x = to_x <= to_y
            travelled = min(to_x, to_y)
            # Rounding may not move the ray off the square's own edge.
            last_col, last_row = past_col - step_x[i], past_row - step_y[i]
            across_col, across_row = int(x + travelled * dx[i]), int(y + travelled * dy[i])
            across_col = min(max(across_col, min(col[i], last_col)), max(col[i], last_col))
            across_row = min(max(across_row, min(row[i], last_row)), max(row[i], last_row))
            col[i] = past_col if through_x else across_col
            row[i] = across_row if through_x else past_row
            # Unsigned, since numba tests whether a signed index is negative.
            ahead[i] = squares[np.uint64(plane[i] + row[i] * wide + col[i])]
            if travelled >= longest:
                out[beam[i]] = np.inf
                ahead[i] = 0
                ended += 1
            elif ahead[i] == 0:
                ended += 1
                inside = 1 <= row[i] <= rows and 1 <= col[i] <= cols
                if inside and cells[row[i] - 1, col[i] - 1] == OCCUPIED:
                    out[beam[i]] = travelled
    return out
