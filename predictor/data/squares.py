"""Squares around the robot: what was seen there and what is true, in codes.

A code is 0 for free, 1 for occupied and 2 for neither. In what was seen, 2 is an unobserved cell.
In the truth, 1 is a surface that a ray can hit, and 2 a cell that can never be observed, such as
inside a wall. A sample holds both in one number, seen + 3 · truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from predictor.mapping.grid import FREE, OCCUPIED, UNKNOWN

if TYPE_CHECKING:
    from torch import Tensor

NOTHING = 2
"""Code of a cell of which nothing is known."""
GREYS = np.array([1, -1, 0], dtype=np.int8)
"""Grey of each code in the images of networks: free is white, occupied black."""
TERNARY = np.array([1.0, 0.0, 0.5])
"""Grey of each code in the images that are scored, as in the paper."""
Codes = TypeVar("Codes", NDArray[np.uint8], "Tensor")


def codes_of(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the codes of a map's cells: 0 for FREE, 1 for OCCUPIED, 2 for UNKNOWN."""
    return truth_codes(cells == FREE, cells == OCCUPIED)


def cells_of(codes: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Return the cells of a map from their codes; the inverse of `codes_of`."""
    return np.array([FREE, OCCUPIED, UNKNOWN], dtype=np.int8)[codes]


def truth_codes(free: NDArray[np.bool_], surface: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the codes of cells that are truly free, or a surface, or neither."""
    return np.where(free, np.uint8(0), np.where(surface, np.uint8(1), np.uint8(NOTHING)))


def joined(seen: NDArray[np.uint8], truth: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the codes of a sample: what was seen and what is true in one number."""
    return seen + np.uint8(3) * truth


def parted(codes: Codes) -> tuple[Codes, Codes]:
    """Return what was seen and what is true, from a sample's codes in an array or a tensor."""
    return codes % 3, codes // 3


@dataclass(frozen=True, eq=False)
class Square:
    """A square around the robot, in codes, (n, n) each.

    Attributes:
        crop: what the whole LIDAR has seen of the 5 m square in the middle; 2 around it. This is
            what the paper's networks are given.
        window: all that a LIDAR confined to its window has seen of the square. This is what a
            planner has.
        truth: what is true there.
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
