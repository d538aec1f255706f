"""What a robot makes of a building: the part that its LIDAR saw, with the errors of mapping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from foresee.mapping.beams import trace_beams
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import FREE, OCCUPIED
from sim.canvas import WALL_CELLS, Canvas
from sim.lidar import cast_rays
from sim.world import empty_squares

BEAMS = 720
"""Number of beams of the robot's LIDAR, all around."""


@dataclass(frozen=True)
class Mapping:
    """How well a robot maps a building.

    Attributes:
        range: range of the LIDAR [m].
        visited: share of the rooms that the robot enters; it sees the others through their doors.
        missing: share of the beams that return nothing.
        drift: standard deviation of the drift, across 10 m of way [m].
        rough: share of the cells along walls that are wrong.
        specks: isolated occupied specks per square metre [1/m²].
        doubled: number of places in which walls appear twice.
    """

    range: float
    visited: float
    missing: float
    drift: float
    rough: float
    specks: float
    doubled: int

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Mapping:
        """Draw how well a robot maps."""
        return cls(
            range=rng.uniform(6.0, 25.0),
            visited=float(rng.choice([0.2, 0.6, 0.95])),
            missing=rng.uniform(0.0, 0.1),
            drift=float(rng.choice([0.0, 0.05, 0.15])),
            rough=rng.uniform(0.03, 0.35),
            specks=float(rng.choice([0.01, 0.1, 0.4])),
            doubled=int(rng.choice([0, 0, 2, 5])),
        )


def survey(
    canvas: Canvas, places: NDArray[np.float64], mapping: Mapping, rng: np.random.Generator
) -> None:
    """Leave free on a canvas only what a LIDAR sees from some places (n, 2) [m]."""
    solid = ~canvas.free
    skips = empty_squares(solid)
    cells = np.where(solid, np.int8(OCCUPIED), np.int8(FREE))
    step = 2 * math.pi / BEAMS
    angles = step * np.arange(BEAMS)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    marks = np.zeros(cells.shape, dtype=np.uint8)
    longest = mapping.range / RESOLUTION
    for x, y in places / RESOLUTION:
        ranges = cast_rays(skips, cells, x, y, 0.0, beams, longest)
        ranges[rng.random(BEAMS) < mapping.missing] = np.nan
        trace_beams(marks, x, y, 0.0, step, ranges, longest)
    # Gaps between neighbouring beams are closed, as in maps of many scans.
    seen = ~_grown(~_grown(marks == 1))
    canvas.free &= seen


def disturb(canvas: Canvas, mapping: Mapping, rng: np.random.Generator) -> None:
    """Add the errors of a robot's map: drift, doubled walls, rough walls and specks."""
    if mapping.drift:
        canvas.free[:] = _drifted(canvas.free, mapping.drift, rng)
    for _ in range(mapping.doubled):
        _double(canvas.free, rng)
    rows, cols = canvas.free.shape
    rough = rng.random((rows // 2 + 1, cols // 2 + 1)) < mapping.rough
    pieces = rough.repeat(2, axis=0).repeat(2, axis=1)[:rows, :cols]
    canvas.free &= ~(pieces & _grown(~canvas.free))
    _speckle(canvas, mapping.specks, rng)


def _drifted(free: NDArray[np.bool_], drift: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Shift each row along x and each column along y, smoothly."""
    shifts = []
    for count in free.shape:
        steps = rng.normal(0.0, drift * RESOLUTION / 10.0 / RESOLUTION, count)
        walk = gaussian_filter1d(np.cumsum(np.cumsum(steps) / 20.0), 20.0)
        slope = np.linspace(0.0, rng.normal(0.0, drift) / 20.0 * count, count)
        shift = walk - walk.mean() + slope - slope.mean()
        shifts.append(np.clip(np.rint(shift), -20, 20).astype(np.intp))
    rows, cols = free.shape
    row = np.arange(rows)[:, None] + shifts[1][None, :]
    col = np.arange(cols)[None, :] + shifts[0][:, None]
    out = free[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)]
    for edge in (out[:WALL_CELLS], out[-WALL_CELLS:], out[:, :WALL_CELLS], out[:, -WALL_CELLS:]):
        edge[:] = False
    return np.asarray(out)


def _double(free: NDArray[np.bool_], rng: np.random.Generator) -> None:
    """Draw the walls in a rectangle again, shifted by some cells."""
    rows, cols = free.shape
    height, width = (rng.uniform(3.0, 15.0, 2) / RESOLUTION).astype(int)
    row, col = int(rng.integers(rows)), int(rng.integers(cols))
    part = free[row : row + height, col : col + width]
    if min(part.shape) < 20:
        return
    surface = ~part & _grown(part)
    line = _grown(surface) & ~_eroded(~part)
    dy, dx = rng.integers(-6, 7, 2)
    shifted = np.zeros_like(line)
    to = (
        slice(max(dy, 0), part.shape[0] + min(dy, 0)),
        slice(max(dx, 0), part.shape[1] + min(dx, 0)),
    )
    of = (
        slice(max(-dy, 0), part.shape[0] + min(-dy, 0)),
        slice(max(-dx, 0), part.shape[1] + min(-dx, 0)),
    )
    shifted[to] = line[of]
    part &= ~shifted


def _speckle(canvas: Canvas, density: float, rng: np.random.Generator) -> None:
    """Put occupied specks and short smears on free space."""
    rows, cols = np.nonzero(canvas.free)
    count = rng.poisson(density * len(rows) * RESOLUTION**2)
    if not count:
        return
    chosen = rng.integers(len(rows), size=count)
    at = np.stack([cols[chosen] + 0.5, rows[chosen] + 0.5], axis=1) * RESOLUTION
    # A speck is one cell; a smear is a line of up to four.
    length = rng.choice([1, 1, 2, 4], count)
    yaw = rng.uniform(0.0, 2 * math.pi, count)
    away = np.stack([np.cos(yaw), np.sin(yaw)], axis=1) * RESOLUTION
    points = [at[length > i] + i * away[length > i] for i in range(4)]
    canvas.posts(np.concatenate(points))


def _grown(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return cells and their eight neighbours."""
    tall = cells.copy()
    tall[1:] |= cells[:-1]
    tall[:-1] |= cells[1:]
    out = tall.copy()
    out[:, 1:] |= tall[:, :-1]
    out[:, :-1] |= tall[:, 1:]
    return out


def _eroded(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return ~_grown(~cells)
