"""Squares around the robot: the observed and the true map, as codes of cells.

A code is 0 for free, 1 for occupied and 2 for neither. In an observed map, 2 is an unobserved cell.
In a true map, 1 is a surface that a ray can hit, and 2 a cell that can never be observed, such as
inside a wall. A sample holds both codes in one number, seen + 3 · truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN

if TYPE_CHECKING:
    from torch import Tensor

NOTHING = 2
"""Code of a cell that is neither free nor occupied: unobserved, or, in a true map, unobservable."""
GREYS = np.array([1, -1, 0], dtype=np.int8)
"""Grey of each code in the images of networks: free is white, occupied black."""
TERNARY = np.array([1.0, 0.0, 0.5])
"""Grey of each code in the images that are scored, as in the paper."""
Codes = TypeVar("Codes", NDArray[np.uint8], "Tensor")


def encode_cells(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the codes of a map's cells: 0 for FREE, 1 for OCCUPIED, 2 for UNKNOWN."""
    return truth_codes(cells == FREE, cells == OCCUPIED)


def decode_cells(codes: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Return the cells of a map from their codes; the inverse of `encode_cells`."""
    return np.array([FREE, OCCUPIED, UNKNOWN], dtype=np.int8)[codes]


def truth_codes(free: NDArray[np.bool_], surface: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the codes of a true map.

    Args:
        free: cells that are free.
        surface: cells that are a surface that a ray can hit; the same shape.
    """
    return np.where(free, np.uint8(0), np.where(surface, np.uint8(1), np.uint8(NOTHING)))


def joined(seen: NDArray[np.uint8], truth: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the observed and the true code of each cell as one number, seen + 3 · truth."""
    return seen + np.uint8(3) * truth


def parted(codes: Codes) -> tuple[Codes, Codes]:
    """Return the observed and the true codes of a sample; the inverse of `joined`."""
    return codes % 3, codes // 3


@dataclass(frozen=True, eq=False)
class Square:
    """A square around the robot, in codes, (n, n) each.

    Attributes:
        crop: observed map of the 5 m square in the middle, by the whole LIDAR; 2 around it. This is
            the input of the paper's networks.
        window: observed map of the whole square, by a LIDAR that is used within its window only.
            This is what a planner has.
        truth: true map.
    """

    crop: NDArray[np.uint8]
    window: NDArray[np.uint8]
    truth: NDArray[np.uint8]

    @classmethod
    def of(
        cls, crop: NDArray[np.uint8], window: NDArray[np.uint8], truth: NDArray[np.uint8]
    ) -> Square:
        """Return the square of a truth (n, n), from a smaller crop and a larger window."""
        edge = (len(truth) - len(crop)) // 2
        return cls(np.pad(crop, edge, constant_values=NOTHING), middle(window, len(truth)), truth)


def middle(codes: NDArray[np.uint8], n: int) -> NDArray[np.uint8]:
    """Return the n × n cells in the middle of a square."""
    first = (len(codes) - n) // 2
    return codes[first : first + n, first : first + n]
