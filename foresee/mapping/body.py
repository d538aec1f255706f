"""The robot's body: a rectangle, and the cells that it covers on a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.kernels import njit


@dataclass(frozen=True)
class Body:
    """A rectangle whose centre is the robot's (x, y).

    Attributes:
        length: extent along the heading [m].
        width: extent across it [m].

    Raises:
        ValueError: if the length or the width is not positive and finite.
    """

    length: float = 0.5
    width: float = 0.3

    def __post_init__(self) -> None:
        for name in ("length", "width"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)} m, it must be positive")

    @property
    def half_length(self) -> float:
        """Half the length [m]."""
        return 0.5 * self.length

    @property
    def half_width(self) -> float:
        """Half the width [m]."""
        return 0.5 * self.width

    @property
    def halves(self) -> tuple[float, float]:
        """Half the length and half the width [m], as arguments of kernels."""
        return self.half_length, self.half_width

    @property
    def radius(self) -> float:
        """Radius of the circle around the whole body [m]."""
        return math.hypot(self.half_length, self.half_width)

    def circles(self, count: int | None = None) -> tuple[NDArray[np.float64], float]:
        """Return circles that together cover the body.

        Args:
            count: number of circles; None: the length divided by the width, rounded up.

        Returns:
            Offsets of their centres along the body (count,) and their radius [m].
        """
        count = count or max(1, math.ceil(self.length / self.width))
        half = 0.5 * self.length / count
        return half * np.arange(1.0 - count, count, 2.0), math.hypot(half, self.half_width)

    def inflated(self, margin: float) -> Body:
        """Return a body larger by `margin` on every side [m]."""
        return Body(self.length + 2 * margin, self.width + 2 * margin)


class Scene(NamedTuple):
    """Obstacles on a grid, and the body that is tested against them, as kernels read them.

    Attributes:
        blocked: cells that the body must not meet, (rows, columns); outside, all are blocked.
        resolution: side of a cell [m].
        origin: x, y of the grid's lower-left corner [m].
        half_length: half the body's extent along its yaw [m].
        half_width: half its extent across [m].
    """

    blocked: NDArray[np.bool_]
    resolution: float
    origin: tuple[float, float]
    half_length: float
    half_width: float


@njit(cache=True, nogil=True, inline="always")
def _overlaps(dx, dy, cos, sin, half_length, half_width, half):  # type: ignore[no-untyped-def]
    """Return whether a rectangle overlaps or touches an axis-aligned square centred at dx, dy.

    The test uses the separating axes of the two boxes (Gottschalk et al. 1996); dx and dy are
    relative to the rectangle's centre.
    """
    reach = half * (abs(cos) + abs(sin))
    return (
        abs(dx) <= half + half_length * abs(cos) + half_width * abs(sin)
        and abs(dy) <= half + half_length * abs(sin) + half_width * abs(cos)
        and abs(dx * cos + dy * sin) <= half_length + reach
        and abs(dy * cos - dx * sin) <= half_width + reach
    )


@njit(cache=True, nogil=True)
def covered(shape, resolution, origin, x, y, yaw, half_length, half_width):  # type: ignore[no-untyped-def]
    """Return rows and columns of the cells of a grid that a rectangle overlaps, (n, 2)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    ex = half_length * abs(cos) + half_width * abs(sin)
    ey = half_length * abs(sin) + half_width * abs(cos)
    r0 = max(0, math.floor((y - ey - origin[1]) / resolution))
    r1 = min(shape[0] - 1, math.floor((y + ey - origin[1]) / resolution))
    c0 = max(0, math.floor((x - ex - origin[0]) / resolution))
    c1 = min(shape[1] - 1, math.floor((x + ex - origin[0]) / resolution))
    cells = np.empty((max(0, r1 - r0 + 1) * max(0, c1 - c0 + 1), 2), dtype=np.int64)
    count = 0
    for row in range(r0, r1 + 1):
        for col in range(c0, c1 + 1):
            dx = origin[0] + (col + 0.5) * resolution - x
            dy = origin[1] + (row + 0.5) * resolution - y
            if _overlaps(dx, dy, cos, sin, half_length, half_width, 0.5 * resolution):
                cells[count, 0] = row
                cells[count, 1] = col
                count += 1
    return cells[:count]


@njit(cache=True, nogil=True)
def first_contact(scene, poses):  # type: ignore[no-untyped-def]
    """Return the index of the first pose at which the body meets a blocked cell; -1 if none.

    Args:
        scene: obstacles and body.
        poses: x, y, yaw of each pose, (n, 3) [m, m, rad].
    """
    for i in range(poses.shape[0]):
        if meets(scene, poses[i, 0], poses[i, 1], poses[i, 2]):
            return i
    return -1


@njit(cache=True, nogil=True)
def meets(scene, x, y, yaw):  # type: ignore[no-untyped-def]
    """Return whether the body overlaps a blocked cell at a pose, or leaves the grid."""
    blocked, resolution, origin, half_length, half_width = scene
    rows, cols = blocked.shape
    cos, sin = math.cos(yaw), math.sin(yaw)
    ex = half_length * abs(cos) + half_width * abs(sin)
    ey = half_length * abs(sin) + half_width * abs(cos)
    r0 = math.floor((y - ey - origin[1]) / resolution)
    r1 = math.floor((y + ey - origin[1]) / resolution)
    c0 = math.floor((x - ex - origin[0]) / resolution)
    c1 = math.floor((x + ex - origin[0]) / resolution)
    if r0 < 0 or c0 < 0 or r1 >= rows or c1 >= cols:
        return True
    for row in range(r0, r1 + 1):
        for col in range(c0, c1 + 1):
            if blocked[row, col]:
                dx = origin[0] + (col + 0.5) * resolution - x
                dy = origin[1] + (row + 0.5) * resolution - y
                if _overlaps(dx, dy, cos, sin, half_length, half_width, 0.5 * resolution):
                    return True
    return False
