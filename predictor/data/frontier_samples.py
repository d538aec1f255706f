"""Samples of frontiers: what was observed around each, and where it truly leads.

A folder holds one file for each building, see `predictor.data.packed_samples`:

    pictures  packed pictures
    numbers   (n, GOALS, 6) float32: for each of several goals the columns of `COLUMNS`
    sizes     (n,) float32: number of cells of each frontier
    about     format, family, seed, and the hash of the building

A picture shows the surroundings of a frontier, (3, SIDE, SIDE) uint8: the percentages of each cell
that were observed free, and observed occupied, and 100 where the frontier is.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import FREE, OCCUPIED, Grid
from predictor.data.packed_samples import PackedSamples

FORMAT = 1
CELL = 0.25
"""Side of a cell of a picture [m]."""
SIDE = 80
"""Side of a picture [cells]: 20 m."""
GOALS = 3
"""Number of goals of a sample: that of the drive, and others drawn at random."""
LARGEST_BACK = 20.0
"""Largest way back [m]: the car would have tried another frontier before."""
SIGHT = 1.0
"""Distance from the end of a dead end at which the car has seen that it is one [m]."""
COLUMNS = ("dx", "dy", "to_go", "leads", "way", "beyond")
"""x, y of the goal from the picture's middle [m]; cost to go [m], see `Frontier.to_go`; whether the
frontier leads to the goal (1 or 0); length of the way if it does [m]; length of the longest way
into the space beyond the frontier [m]."""
Array = TypeVar("Array", bound=Any)
"""A NumPy array or a torch tensor."""


def frontier_pictures(
    known: Grid, frontiers: Sequence[Frontier]
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return the pictures of frontiers, (n, 3, SIDE, SIDE), and their middles, (n, 2) [m].

    Args:
        known: map of all that was observed.
        frontiers: frontiers of this map.
    """
    shares = _percentages(known)
    origin, half = np.array(known.frame.origin), SIDE // 2
    pictures = np.zeros((len(frontiers), 3, SIDE, SIDE), dtype=np.uint8)
    middles = np.zeros((len(frontiers), 2))
    for picture, middle, frontier in zip(pictures, middles, frontiers, strict=True):
        col, row = np.rint((frontier.middle - origin) / CELL).astype(int)
        picture[:2] = shares[:, row : row + SIDE, col : col + SIDE]
        middle[:] = origin + CELL * np.array([col, row])
        cols, rows = np.floor((frontier.points - middle) / CELL).astype(int).T + half
        inside = (np.minimum(rows, cols) >= 0) & (np.maximum(rows, cols) < SIDE)
        picture[2, rows[inside], cols[inside]] = 100
    return pictures, middles


def _percentages(known: Grid) -> NDArray[np.uint8]:
    """Return the percentages of free and of occupied in cells of `CELL`, with half a `SIDE` around.

    The result is of shape (2, rows, columns).
    """
    factor = max(1, round(CELL / known.frame.resolution))
    rows, cols = (-(-n // factor) for n in known.frame.shape)
    cells = np.full((rows * factor, cols * factor), -1, dtype=np.int8)
    cells[: known.cells.shape[0], : known.cells.shape[1]] = known.cells
    half = SIDE // 2
    shares = np.zeros((2, rows + SIDE, cols + SIDE), dtype=np.uint8)
    for share, kind in zip(shares, (FREE, OCCUPIED), strict=True):
        here = (cells == kind).astype(np.int32)
        # Rows first: numpy is slow over axes as short as `factor`.
        lines = sum(here[i::factor] for i in range(factor))
        counts = np.asarray(sum(lines[:, i::factor] for i in range(factor)))
        share[half : half + rows, half : half + cols] = 100 * counts // factor**2
    return shares


def way_back(beyond: Array) -> Array:
    """Return the distance driven in vain into dead ends and back [m].

    Args:
        beyond: length of the longest way into the space beyond each frontier [m].
    """
    driven: Array = (2.0 * (beyond - SIGHT)).clip(0.0, LARGEST_BACK)
    return driven


def write_frontiers(
    path: Path,
    pictures: Sequence[NDArray[np.uint8]],
    numbers: Sequence[NDArray[np.float32]],
    sizes: Sequence[float],
    about: dict[str, Any],
) -> None:
    """Write the samples of a building, whole or not at all.

    Args:
        path: path of the file.
        pictures: pictures of the frontiers, (3, SIDE, SIDE) each.
        numbers: columns of `COLUMNS` for each goal, (GOALS, 6) each.
        sizes: number of cells of each frontier.
        about: facts: "family", "seed" and "world", the hash of the building.
    """
    FrontierSamples.write(
        path,
        [zlib.compress(picture.tobytes(), 3) for picture in pictures],
        about,
        numbers=np.array(numbers, dtype=np.float32).reshape(-1, GOALS, len(COLUMNS)),
        sizes=np.array(sizes, dtype=np.float32),
    )


class FrontierSamples(PackedSamples):
    """All samples of some buildings, the pictures compressed."""

    NAME, NEEDED, COMMAND = "pictures", ("world", "family"), "predictor.train_frontiers"
    HEAD: ClassVar = {"format": FORMAT}
    SIZE = 3 * SIDE**2
    ARRAYS: ClassVar = {"numbers": (GOALS, len(COLUMNS)), "sizes": ()}

    @property
    def numbers(self) -> NDArray[np.float32]:
        """Columns of `COLUMNS` for each goal, (n, GOALS, 6)."""
        return self.arrays["numbers"]

    @property
    def sizes(self) -> NDArray[np.float32]:
        """Number of cells of each frontier, (n,)."""
        return self.arrays["sizes"]

    def picture(self, index: int) -> NDArray[np.uint8]:
        """Return the picture of a sample, (3, SIDE, SIDE).

        Raises:
            SamplesError: if it is damaged.
        """
        return self.unpacked(index, 100).reshape(3, SIDE, SIDE)
