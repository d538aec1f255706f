"""An exact test of drives for contacts on the true map, independent of planner and simulator."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.body import Body
from foresee.mapping.grid import GridFrame

STEP = 0.005
"""Largest distance that a point of the body moves between two tested poses [m]. A contact that lies
between two of them is missed if it is less than half of this deep."""
ROUNDING = 1e-9
"""Depth up to which an overlap counts as none [m]: bodies that only touch a cell's side."""


def touches(
    states: NDArray[np.float64], solid: NDArray[np.bool_], frame: GridFrame, body: Body
) -> bool:
    """Return whether the body has met a solid cell, or left the map, on a drive.

    Args:
        states: x, y, yaw, v at the start and at the end of each tick, (T+1, 4). In between the car
            drives on one circular arc.
        solid: cells that are not free in the true map, (rows, columns).
        frame: frame of the map.
        body: body of the car.
    """
    poses = _along(states, body.radius)
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    half = np.column_stack(
        [
            abs(cos) * body.half_length + abs(sin) * body.half_width,
            abs(sin) * body.half_length + abs(cos) * body.half_width,
        ]
    )
    # Columns and rows of the cells around the body, the last ones excluded.
    centres = poses[:, :2] - frame.origin
    first = np.floor((centres - half) / frame.resolution).astype(int)
    last = np.floor((centres + half) / frame.resolution).astype(int) + 1
    if first.min() < 0 or (last > solid.shape[::-1]).any():
        return True
    # Sums of all cells before a row and a column: most poses have no solid cell around them.
    sums = np.pad(solid.astype(np.int32).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    (c0, r0), (c1, r1) = first.T, last.T
    near = np.flatnonzero(sums[r1, c1] - sums[r0, c1] - sums[r1, c0] + sums[r0, c0])
    return any(
        _overlaps(
            centres[i],
            (cos[i], sin[i]),
            (np.argwhere(solid[r0[i] : r1[i], c0[i] : c1[i]])[:, ::-1] + first[i] + 0.5)
            * frame.resolution,
            frame.resolution,
            body,
        )
        for i in near
    )


def _overlaps(
    centre: NDArray[np.float64],
    heading: tuple[float, float],
    cells: NDArray[np.float64],
    side: float,
    body: Body,
) -> bool:
    """Return whether a rectangle overlaps any of some cells.

    Two convex shapes are apart if they are along one of their sides' directions.

    Args:
        centre: x, y of the rectangle [m].
        heading: cosine and sine of its yaw.
        cells: x, y of the centres of the cells, (n, 2) [m].
        side: side of a cell [m].
        body: the rectangle.
    """
    (cos, sin), offsets = heading, cells - centre
    turned = offsets @ np.array([[cos, -sin], [sin, cos]])
    wide, half = abs(cos) + abs(sin), 0.5 * side - ROUNDING
    length, width = body.half_length, body.half_width
    met = abs(turned) < np.array([length, width]) + half * wide
    met &= abs(offsets) < half + np.array(
        [length * abs(cos) + width * abs(sin), length * abs(sin) + width * abs(cos)]
    )
    return bool(met.all(axis=1).any())


def _along(states: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return poses x, y, yaw along the arcs between some states, (n, 3).

    No point within `radius` [m] of the centre moves by more than `STEP` from pose to pose.
    """
    parts = [states[:1, :3]]
    for before, after in pairwise(states):
        chord = complex(*(after[:2] - before[:2]))
        turn = math.remainder(after[2] - before[2], 2.0 * math.pi)
        length = abs(chord) / np.sinc(0.5 * turn / math.pi)
        count = max(1, math.ceil((length + radius * abs(turn)) / STEP))
        share = np.arange(1, count + 1) / count
        # In the complex plane, an arc of curvature κ is proportional to exp(iκs) − 1.
        moved = chord * (np.expm1(1j * turn * share) / np.expm1(1j * turn) if turn else share)
        parts.append(
            np.column_stack(
                [before[0] + moved.real, before[1] + moved.imag, before[2] + turn * share]
            )
        )
    return np.vstack(parts)
