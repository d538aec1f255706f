"""Beams on a grid: which cells a scan crosses, and which it ends in."""

from __future__ import annotations

import math

import numpy as np

from predictor.mapping.kernels import njit

_TINY = 1e-6
"""A beam whose way through a cell is shorter than this does not cross the cell [cells]."""
_ONE = 2.0**40
"""One cell in fixed point."""
_MOST = 32
"""Maximum distance, in beams, of the two beams that cover one between them near the sensor."""
_SURE = 0.999
"""Beams at most this far apart touch every cell between them [cells]."""


@njit(cache=True, nogil=True)
def trace_beams(marks, x, y, first, step, ranges, longest):  # type: ignore[no-untyped-def]
    """Mark the cells that beams cross (1) and end in (2).

    Exact: a beam is followed along its longer axis; in each column (or row) that it passes it
    touches at most two cells. A cell is crossed when the beam's way inside it is longer than
    about 1e-6 cells, so that rounding never frees a cell that a beam only grazes at a corner.

    Near the sensor beams lie so close that the beams on both sides of one touch all that it does:
    it is followed only from where they are a cell apart. So every second beam begins some way
    out, of the others every second one not quite as far, and so on.

    Args:
        marks: (rows, columns) uint8, contiguous, written in place; cells outside it are passed
            over.
        x: sensor position along the columns [cells].
        y: sensor position along the rows [cells].
        first: direction of beam 0 [rad].
        step: angle between beams [rad].
        ranges: (beams,) [cells]; NaN says nothing.
        longest: the sensor's range [cells].
    """
    rows, cols = marks.shape
    # All of the grid is nearer than this, and infinity has no column.
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
            # At most as many columns as it leaves behind, the sensor's own included.
            passed[beam] = max(0, int(min(ranges[beam], farthest) * abs(du)) - 1)
    for beam in range(count):
        if ranges[beam] > 0.0:
            length = min(ranges[beam], farthest)
            skip = _spared(beam, slope, sector, passed)
            if sector[beam] >= 2:
                _cross(flat, y, x, sin[beam], slope[beam], length, skip, rows, cols, cols, 1)
            else:
                _cross(flat, x, y, cos[beam], slope[beam], length, skip, cols, rows, 1, cols)
    # Last, since a cell that one beam ends in is a hit whatever other beams cross it.
    for beam in range(count):
        if 0.0 < ranges[beam] < longest:
            # A beam that ends on a cell's side ends in the cell beyond, the one that stopped it.
            row = math.floor(y + sin[beam] * ranges[beam] + math.copysign(_TINY, sin[beam]))
            col = math.floor(x + cos[beam] * ranges[beam] + math.copysign(_TINY, cos[beam]))
            if 0 <= row < rows and 0 <= col < cols:
                marks[row, col] = 2


@njit(cache=True, nogil=True)
def _spared(beam, slope, sector, passed):  # type: ignore[no-untyped-def]
    """Return how many columns of a beam the beams on both sides of it cover."""
    # The largest power of two that divides its number: both neighbours at that distance begin
    # nearer to the sensor than it does.
    apart = beam & -beam
    below, above = beam - apart, beam + apart
    if not 0 < apart <= _MOST or above >= slope.size:
        return 0
    if not sector[below] == sector[beam] == sector[above]:
        return 0
    # Beams of the same direction are no distance apart, wherever.
    gap = max(abs(slope[above] - slope[below]), 1e-9)
    return min(passed[below], passed[above], int(_SURE / gap))


@njit(cache=True, nogil=True)
def _cross(flat, u, w, du, slope, length, skip, nu, nw, step_u, step_w):  # type: ignore[no-untyped-def]
    """Mark what one beam crosses after `skip` columns; u runs along its longer axis, w across."""
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
    # Nearly all the time goes here: no branches, and a shift for each floor.
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
