"""Foresight: the cells that the car will have seen from a place, if the predictions are true."""

from __future__ import annotations

import math

from foresee.mapping.kernels import njit


@njit(cache=True, nogil=True)
def reveal(certain, barred, safe, resolution, origin, x, y, half):  # type: ignore[no-untyped-def]
    """Add to the certain cells those that will be seen from a place.

    Rays are cast to the edge of the window around the place. They end at barred cells; the other
    cells on them that a plan may enter become certain.

    Args:
        certain: cells that are certain, which is written to, (rows, columns).
        barred: cells that are or are predicted to be occupied, (rows, columns).
        safe: cells that a plan may enter, (rows, columns).
        resolution: side of a cell [m].
        origin: x, y of the grid's lower-left corner [m].
        x: x of the place [m].
        y: y of the place [m].
        half: half the side of the window [m].
    """
    rows, cols = certain.shape
    col0, row0 = (x - origin[0]) / resolution, (y - origin[1]) / resolution
    count = int(half / resolution)
    steps = 2 * count
    for i in range(4 * steps):
        side, along = i // steps, i % steps - count
        if side == 0:
            up, right = along, count
        elif side == 1:
            up, right = count, -along
        elif side == 2:
            up, right = -along, -count
        else:
            up, right = -count, along
        for k in range(steps + 1):
            row = math.floor(row0 + up * k / steps)
            col = math.floor(col0 + right * k / steps)
            if row < 0 or col < 0 or row >= rows or col >= cols or barred[row, col]:
                break
            if safe[row, col]:
                certain[row, col] = True
