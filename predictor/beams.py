"""Beams on a grid: which cells a scan crosses, and which it ends in."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_TINY = 1e-6
"""A way through a cell that is shorter than this is a graze and does not cross it [cells]."""
_ONE = 2.0**40
"""One cell in fixed point."""


@njit(cache=True, nogil=True)
def trace_beams(marks, x, y, first, step, ranges, longest):  # type: ignore[no-untyped-def]
    """Mark the cells that beams cross (1) and end in (2).

    Exact: a beam is followed along its longer axis; in each column (or row) that it passes it
    touches at most two cells. A cell is crossed when the beam's way inside it is longer than
    about 1e-6 cells, so that rounding never frees a cell that a beam only grazes at a corner.

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
    flat = marks.reshape(-1)
    for beam in range(ranges.size):
        if ranges[beam] > 0.0:
            length = min(ranges[beam], longest)
            cos, sin = math.cos(first + beam * step), math.sin(first + beam * step)
            if abs(sin) > abs(cos):
                _cross(flat, y, x, sin, cos, length, rows, cols, cols, 1)
            else:
                _cross(flat, x, y, cos, sin, length, cols, rows, 1, cols)
    # Last, since a cell that one beam ends in is a hit whatever other beams cross it.
    for beam in range(ranges.size):
        if 0.0 < ranges[beam] < longest:
            cos, sin = math.cos(first + beam * step), math.sin(first + beam * step)
            # A beam that ends on a cell's side ends in the cell beyond, the one that stopped it.
            row = math.floor(y + sin * ranges[beam] + math.copysign(_TINY, sin))
            col = math.floor(x + cos * ranges[beam] + math.copysign(_TINY, cos))
            if 0 <= row < rows and 0 <= col < cols:
                marks[row, col] = 2


@njit(cache=True, nogil=True)
def _cross(flat, u, w, du, dw, length, nu, nw, step_u, step_w):  # type: ignore[no-untyped-def]
    """Mark what one beam crosses; u runs along its longer axis, w across it."""
    slope = dw / du
    lo = max(min(u, u + du * length) + _TINY, 0.0)
    hi = min(max(u, u + du * length) - _TINY, float(nu))
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
