"""Visibility with errors: the cells that are free wherever in their bounds the errors lie.

`foresee.mapping.beams` marks the cells that beams cross, which is exact for an exact pose on the
lattice of the world. Here a cell counts only if all that lies within the bounds of error around it
was in sight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from foresee.mapping.kernels import njit

_DIAGONAL = math.sqrt(2.0)
"""Diagonal of a cell [cells]. An obstacle is assumed to be at least as large as a cell: it cannot
lie between two beams that are less than a cell apart, but a corner of it can, by a diagonal at
most."""


class SensingBounds(NamedTuple):
    """Bounds of the errors of a scan, as kernels read them.

    Attributes:
        position: largest error of the sensor's position [cells].
        yaw: largest error of its yaw [rad].
        range: largest error of a range [cells].
    """

    position: float
    yaw: float
    range: float


@njit(cache=True, nogil=True)
def mark_visible(marks, x, y, first, step, ranges, longest, bounds):  # type: ignore[no-untyped-def]
    """Mark the cells that are free within the bounds of error (1), and those beams end in (2).

    A cell is free if a disc around it was in sight in front of all obstacles. Its radius is how far
    the cell may be from where it seems, plus half the cell's diagonal.

    Args:
        marks: marks of the cells, (rows, columns) uint8, written in place.
        x: sensor position along the columns [cells].
        y: sensor position along the rows [cells].
        first: direction of beam 0 [rad].
        step: angle from one beam to the next [rad].
        ranges: range of each beam, (beams,) [cells]; NaN: no measurement.
        longest: largest range of the sensor [cells].
        bounds: `SensingBounds`.
    """
    rows, cols = marks.shape
    free = _without_gaps(ranges, longest, abs(step))
    lowest, farthest = _lowest(free), free.max()
    count = ranges.size
    full = abs(step) * count >= 2.0 * math.pi - 1e-6
    for row in range(rows):
        for col in range(cols):
            dx, dy = col + 0.5 - x, row + 0.5 - y
            away = math.hypot(dx, dy)
            radius = bounds.position + bounds.yaw * away + 0.5 * _DIAGONAL
            near = away + radius + bounds.range + _DIAGONAL
            if away <= radius or farthest < near:
                continue
            turn = math.atan2(dy, dx) - first
            turn = (turn if step > 0.0 else -turn) % (2.0 * math.pi)
            # The beam towards the middle of the cell alone decides for most cells, and is cheap.
            middle = int(turn / abs(step))
            if (middle >= count and not full) or free[middle % count] < near:
                continue
            half = math.asin(radius / away)
            begin = math.floor((turn - half) / abs(step))
            end = math.ceil((turn + half) / abs(step))
            if not full and (begin < 0 or end >= count):
                continue
            if _least(lowest, begin, end, count) >= near:
                marks[row, col] = 1
    for beam in range(count):
        if 0.0 < ranges[beam] < longest:
            angle = first + beam * step
            row = math.floor(y + math.sin(angle) * ranges[beam])
            col = math.floor(x + math.cos(angle) * ranges[beam])
            if 0 <= row < rows and 0 <= col < cols:
                marks[row, col] = 2


@njit(cache=True, nogil=True)
def _without_gaps(ranges, longest, step):  # type: ignore[no-untyped-def]
    """Return up to where no obstacle of a cell's size is in the way of each beam, (beams,).

    A beam without a measurement is as free as its neighbours with one, up to the distance at which
    an obstacle fits between these.
    """
    free = np.zeros(ranges.size)
    last = -1
    for beam in range(ranges.size):
        if not ranges[beam] >= 0.0:
            continue
        free[beam] = min(ranges[beam], longest, 1.0 / step)
        if last >= 0 and beam - last > 1:
            gap = min(free[last], free[beam], 1.0 / ((beam - last) * step))
            free[last + 1 : beam] = gap
        last = beam
    return free


@njit(cache=True, nogil=True)
def _lowest(ranges):  # type: ignore[no-untyped-def]
    """Return the least of each 2^i ranges in succession, (i, beams): a sparse table."""
    count = ranges.size
    levels = max(1, int(math.log2(max(count, 1))) + 1)
    table = np.empty((levels, count))
    table[0] = ranges
    for level in range(1, levels):
        half = 1 << (level - 1)
        for beam in range(count):
            other = min(beam + half, count - 1)
            table[level, beam] = min(table[level - 1, beam], table[level - 1, other])
    return table


@njit(cache=True, nogil=True)
def _least(table, begin, end, count):  # type: ignore[no-untyped-def]
    """Return the least range of the beams from `begin` to `end`, modulo their number."""
    if end - begin >= count:
        begin, end = 0, count - 1
    begin, end = begin % count, end % count
    if begin > end:
        # Across the end of a full circle.
        return min(_least_of(table, begin, count - 1), _least_of(table, 0, end))
    return _least_of(table, begin, end)


@njit(cache=True, nogil=True)
def _least_of(table, begin, end):  # type: ignore[no-untyped-def]
    """Return the least range of the beams from `begin` to `end`."""
    level = int(math.log2(end - begin + 1))
    return min(table[level, begin], table[level, end - (1 << level) + 1])
