"""Straight lines in an observed map: the main direction of its walls, and observations along it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from foresee.mapping.kernels import njit

NONE, OPEN, WALL = 0, 1, 2
"""Last observation along a line: none, free space, a wall."""


def main_direction(cells: NDArray[np.int8], default: float) -> float:
    """Return the direction of most walls seen, modulo a right angle, in [0, pi/2) [rad].

    Args:
        cells: map of FREE, OCCUPIED, UNKNOWN, (rows, columns).
        default: direction to return if the map shows too few walls [rad].
    """
    votes = _wall_angles(cells)
    if votes.sum() < 5.0:
        return default % (0.5 * math.pi)
    ring = np.concatenate([votes[-2:], votes, votes[:2]])
    peak = int(np.convolve(ring, [1.0, 2.0, 3.0, 2.0, 1.0], "valid").argmax())
    around = np.arange(-5, 6)
    weights = votes[(peak + around) % 90]
    return math.radians((peak + weights @ around / weights.sum()) % 90.0)


def look_back(
    cells: NDArray[np.int8], angle: float, memory: float
) -> tuple[NDArray[np.int8], NDArray[np.float32], NDArray[np.float32]]:
    """Find the nearest observed cell from each unobserved cell, along four directions.

    Args:
        cells: map of FREE, OCCUPIED, UNKNOWN, (rows, columns).
        angle: direction of the first line; the others are opposite and across [rad].
        memory: length of observed line over which its support rises to 1 - 1/e [cells].

    Returns:
        For each direction, (4, rows, columns) each: kind of the observed cell, NONE, OPEN or WALL;
        its distance [cells]; and its support in [0, 1], which grows with the length over which the
        line had been free, or had run along a wall. Observed cells are 0.
    """
    shape = (4, *cells.shape)
    kind = np.zeros(shape, dtype=np.int8)
    distance = np.zeros(shape, dtype=np.float32)
    support = np.zeros(shape, dtype=np.float32)
    cos, sin = math.cos(angle), math.sin(angle)
    for i in range(4):
        dx, dy = (cos, sin) if i < 2 else (-sin, cos)
        if abs(dx) >= abs(dy):
            _look(cells, dy / dx, i % 2 == 1, memory, kind[i], distance[i], support[i])
        else:
            _look(cells.T, dx / dy, i % 2 == 1, memory, kind[i].T, distance[i].T, support[i].T)
    return kind, distance, support


@njit(cache=True, nogil=True)
def _wall_angles(cells):  # type: ignore[no-untyped-def]
    """Return a histogram of the walls' directions modulo a right angle, one bin per degree, (90,).

    Each occupied cell votes for the principal axis of the occupied cells around it, with a weight
    that grows as they form a straighter line.
    """
    rows, cols = cells.shape
    reach = 8
    votes = np.zeros(90)
    for row in range(rows):
        for col in range(cols):
            if cells[row, col] != OCCUPIED:
                continue
            n, sx, sy, sxx, syy, sxy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for dy in range(max(-reach, -row), min(reach, rows - 1 - row) + 1):
                for dx in range(max(-reach, -col), min(reach, cols - 1 - col) + 1):
                    if cells[row + dy, col + dx] == OCCUPIED:
                        n += 1.0
                        sx += dx
                        sy += dy
                        sxx += dx * dx
                        syy += dy * dy
                        sxy += dx * dy
            if n < reach:
                continue
            cxx, cyy, cxy = sxx - sx * sx / n, syy - sy * sy / n, sxy - sx * sy / n
            spread = math.hypot(cxx - cyy, 2.0 * cxy)
            stretch = spread / (cxx + cyy)
            angle = math.degrees(0.5 * math.atan2(2.0 * cxy, cxx - cyy)) % 90.0
            low = math.floor(angle)
            weight = stretch**4
            votes[low % 90] += weight * (1.0 - angle + low)
            votes[(low + 1) % 90] += weight * (angle - low)
    return votes


@njit(cache=True, nogil=True)
def _look(cells, slope, backwards, memory, kind, distance, support):  # type: ignore[no-untyped-def]
    """Follow all lines of one direction of `look_back`, and write the results into the arrays.

    The lines row = k + round(slope * column) visit each cell once, so that the map need not be
    rotated.
    """
    rows, cols = cells.shape
    stride = math.hypot(1.0, slope)
    keep = math.exp(-stride / memory)
    offset = np.empty(cols, dtype=np.int64)
    for col in range(cols):
        offset[col] = math.floor(slope * col + 0.5)
    lowest, highest = min(offset[0], offset[-1]), max(offset[0], offset[-1])
    for line in range(-highest, rows - lowest):
        last, gap, clear, solid = NONE, 0, 0.0, 0.0
        before = -1
        for i in range(cols):
            col = cols - 1 - i if backwards else i
            row = line + offset[col]
            if not 0 <= row < rows:
                continue
            value = cells[row, col]
            if before >= 0 and before != row:
                # A diagonal step must not pass through a wall whose cells only share corners.
                other = col + 1 if backwards else col - 1
                if cells[before, col] == OCCUPIED and cells[row, other] == OCCUPIED:
                    last, gap, clear = WALL, 0, 0.0
            before = row
            beside = (
                value == OCCUPIED
                or (row > 0 and cells[row - 1, col] == OCCUPIED)
                or (row < rows - 1 and cells[row + 1, col] == OCCUPIED)
            )
            if value == UNKNOWN:
                gap += 1
                if beside:
                    solid = solid * keep + 1.0 - keep
                kind[row, col] = last
                distance[row, col] = gap * stride
                support[row, col] = solid if last == WALL else clear
                continue
            if gap:
                clear *= keep**gap
                solid *= keep**gap
                gap = 0
            solid = solid * keep + (1.0 - keep if beside else 0.0)
            if value == FREE:
                last = OPEN
                clear = clear * keep + 1.0 - keep
            else:
                last = WALL
                clear = 0.0


@njit(cache=True, nogil=True)
def nearness(cells, value, length):  # type: ignore[no-untyped-def]
    """Return exp(-distance / length) to the nearest cell of a value, by (3, 4) chamfer distance."""
    rows, cols = cells.shape
    out = np.zeros((rows, cols), dtype=np.float32)
    straight, diagonal = math.exp(-1.0 / length), math.exp(-4.0 / 3.0 / length)
    for row in range(rows):
        for col in range(cols):
            best = 1.0 if cells[row, col] == value else 0.0
            if col > 0:
                best = max(best, straight * out[row, col - 1])
            if row > 0:
                best = max(best, straight * out[row - 1, col])
                if col > 0:
                    best = max(best, diagonal * out[row - 1, col - 1])
                if col < cols - 1:
                    best = max(best, diagonal * out[row - 1, col + 1])
            out[row, col] = best
    for row in range(rows - 1, -1, -1):
        for col in range(cols - 1, -1, -1):
            best = out[row, col]
            if col < cols - 1:
                best = max(best, straight * out[row, col + 1])
            if row < rows - 1:
                best = max(best, straight * out[row + 1, col])
                if col < cols - 1:
                    best = max(best, diagonal * out[row + 1, col + 1])
                if col > 0:
                    best = max(best, diagonal * out[row + 1, col - 1])
            out[row, col] = best
    return out
