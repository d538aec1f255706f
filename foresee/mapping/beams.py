"""Ray tracing of a scan on a grid: the cells that its beams cross, and those they end in."""

from __future__ import annotations

import math

import numpy as np

from foresee.mapping.kernels import njit

_TINY = 1e-6
"""Shortest path of a beam inside a cell that counts as crossing it [cells]."""
_ONE = 2.0**40
"""One cell in the fixed-point numbers of `_cross`."""
_MOST = 32
"""Largest difference in number between a beam and the two neighbours that cover it near the
sensor."""
_SURE = 0.999
"""Largest distance between two beams at which they touch every cell between them [cells]."""


@njit(cache=True, nogil=True)
def trace_beams(marks, x, y, first, step, ranges, longest):  # type: ignore[no-untyped-def]
    """Mark the cells that beams cross (1) and end in (2).

    The result is exact: a beam is followed along the axis in which it is longer, and in each column
    (or row) that it passes it touches at most two cells. A cell is crossed if the beam's path
    inside it is longer than about 1e-6 cells, so that rounding never frees a cell that a beam only
    touches at a corner.

    Near the sensor, beams are so close that two neighbours touch all cells of a beam between them.
    Such a beam is followed only from where its neighbours are a cell apart: every second beam
    starts far out, every second one of the others less far, and so on.

    Args:
        marks: marks of the cells, (rows, columns) uint8, contiguous, written in place; cells
            outside of it are ignored.
        x: sensor position along the columns [cells].
        y: sensor position along the rows [cells].
        first: direction of beam 0 [rad].
        step: angle from one beam to the next [rad].
        ranges: range of each beam, (beams,) [cells]; a beam with NaN is ignored.
        longest: largest range of the sensor [cells]; a beam at or above it ends in no cell.
    """
    rows, cols = marks.shape
    # Infinite ranges are cut off at a distance beyond the whole grid.
    farthest = min(longest, rows + cols + abs(x) + abs(y))
    flat = marks.reshape(-1)
    count = ranges.size
    cos, sin, slope = np.empty(count), np.empty(count), np.empty(count)
    sector, passed = np.empty(count, dtype=np.int8), np.zeros(count, dtype=np.int64)
    for beam in range(count):
        cos[beam], sin[beam] = math.cos(first + beam * step), math.sin(first + beam * step)
        # Four sectors: along which axis a beam is followed, and which way.
        steep = abs(sin[beam]) > abs(cos[beam])
        du, dw = (sin[beam], cos[beam]) if steep else (cos[beam], sin[beam])
        slope[beam] = dw / du
        sector[beam] = 2 * steep + (du < 0.0)
        if ranges[beam] > 0.0:
            # A lower bound of the columns that the beam passes, the sensor's own included.
            passed[beam] = max(0, int(min(ranges[beam], farthest) * abs(du)) - 1)
    for beam in range(count):
        if ranges[beam] > 0.0:
            length = min(ranges[beam], farthest)
            skip = _spared(beam, slope, sector, passed)
            if sector[beam] >= 2:
                _cross(flat, y, x, sin[beam], slope[beam], length, skip, rows, cols, cols, 1)
            else:
                _cross(flat, x, y, cos[beam], slope[beam], length, skip, cols, rows, 1, cols)
    # Hits are marked last: a cell that a beam ends in is a hit even if other beams cross it.
    for beam in range(count):
        if 0.0 < ranges[beam] < longest:
            end_x, end_y = x + cos[beam] * ranges[beam], y + sin[beam] * ranges[beam]
            beside = abs(end_x - round(end_x)) < _TINY, abs(end_y - round(end_y)) < _TINY
            along = abs(sin[beam]) < _TINY, abs(cos[beam]) < _TINY
            if (beside[0] and beside[1]) or (beside[1] and along[0]) or (beside[0] and along[1]):
                # Its end is a corner, or it runs along the line between two cells: each of the
                # cells that meet there may have stopped it, and the others may be free.
                continue
            # A beam that ends on a cell's side ends in the cell beyond, the one that stopped it.
            row = math.floor(end_y + math.copysign(_TINY, sin[beam]))
            col = math.floor(end_x + math.copysign(_TINY, cos[beam]))
            if 0 <= row < rows and 0 <= col < cols:
                marks[row, col] = 2


@njit(cache=True, nogil=True)
def _spared(beam, slope, sector, passed):  # type: ignore[no-untyped-def]
    """Return how many columns of a beam, from the sensor on, its neighbours cover."""
    # The largest power of two that divides the beam's number: both neighbours at that distance
    # are followed from nearer to the sensor.
    apart = beam & -beam
    below, above = beam - apart, beam + apart
    if not 0 < apart <= _MOST or above >= slope.size:
        return 0
    if not sector[below] == sector[beam] == sector[above]:
        return 0
    # Beams of the same direction have no distance, hence the bound.
    gap = max(abs(slope[above] - slope[below]), 1e-9)
    return min(passed[below], passed[above], int(_SURE / gap))


@njit(cache=True, nogil=True)
def _cross(flat, u, w, du, slope, length, skip, nu, nw, step_u, step_w):  # type: ignore[no-untyped-def]
    """Mark the cells that a beam crosses after `skip` columns; u runs along its longer axis.

    w runs across. For a beam that is longer along y, rows take the place of columns.
    """
    lo = max(min(u, u + du * length) + _TINY, 0.0)
    hi = min(max(u, u + du * length) - _TINY, float(nu))
    if skip > 0:
        if du > 0.0:
            lo = max(lo, math.floor(u) + skip + _TINY)
        else:
            hi = min(hi, math.floor(u) + 1 - skip - _TINY)
    sloping = abs(slope) > 4 * _TINY
    if sloping:  # Cut the beam where it leaves the grid sideways.
        side, other = u - w / slope, u + (nw - w) / slope
        lo, hi = max(lo, min(side, other)), min(hi, max(side, other))
    if not lo < hi:
        return
    # The columns that the beam passes from side to side, all inside the grid.
    start, stop = math.floor(lo), min(nu - 1, math.floor(hi))
    begin, end = (start + 1, stop) if sloping and stop > start else (stop + 1, stop + 1)
    for column in range(start, stop + 1):
        if begin <= column < end:
            continue
        a = w + slope * (max(float(column), lo) - u)
        b = w + slope * (min(float(column + 1), hi) - u)
        low, high = math.floor(min(a, b) + _TINY), math.floor(max(a, b) - _TINY)
        for across in range(max(low, 0), min(high, nw - 1) + 1):
            flat[column * step_u + across * step_w] = 1
    # This loop takes nearly all of the time: it has no branches, and shifts in place of floor().
    slope_ = np.int64(slope * _ONE)
    inset = np.int64(math.copysign(_TINY * _ONE, slope))
    enter = np.int64((w + slope * (begin - u)) * _ONE)
    leave = enter + slope_ - inset
    enter += inset
    at = begin * step_u
    for _ in range(end - begin):
        flat[np.uint64(at + (enter >> 40) * step_w)] = 1
        flat[np.uint64(at + (leave >> 40) * step_w)] = 1
        enter += slope_
        leave += slope_
        at += step_u
