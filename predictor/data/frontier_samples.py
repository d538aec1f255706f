"""Samples of frontiers: what was observed around each, and where it truly leads.

A folder holds one file for each building, a NumPy archive that is written atomically and read
without running code from it:

    pictures  (bytes,) uint8            zlib-compressed pictures, one after the other
    ends      (n,) int64                end of each picture in `pictures`
    numbers   (n, GOALS, 6) float32     for each of several goals: the columns of `COLUMNS`
    sizes     (n,) float32              number of cells of each frontier
    about     (bytes,) uint8            JSON: format, family, seed, and the hash of the building

A picture shows the surroundings of a frontier, (3, SIDE, SIDE) uint8: the percentages of each cell
that were observed free, and observed occupied, and 100 where the frontier is.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import one_line
from foresee.infra.plain_json import loads
from foresee.infra.resumable import UNREADABLE, as_bytes, write_arrays
from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import FREE, OCCUPIED, Grid
from predictor.data.samples import SamplesError

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


def pictures_of(
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
    packed = [zlib.compress(picture.tobytes(), 3) for picture in pictures]
    arrays: dict[str, NDArray[Any]] = {
        "pictures": np.frombuffer(b"".join(packed), dtype=np.uint8),
        "ends": np.cumsum([len(one) for one in packed], dtype=np.int64),
        "numbers": np.array(numbers, dtype=np.float32).reshape(-1, GOALS, len(COLUMNS)),
        "sizes": np.array(sizes, dtype=np.float32),
        "about": as_bytes({"format": FORMAT} | about),
    }
    write_arrays(path, arrays, compress=False)


@dataclass(frozen=True, eq=False)
class FrontierSamples:
    """All samples of some buildings, the pictures compressed.

    Attributes:
        pictures: bytes of the pictures of each building.
        places: building of each sample, and its begin and end in the bytes, (n, 3).
        numbers: columns of `COLUMNS` for each goal, (n, GOALS, 6).
        sizes: number of cells of each frontier, (n,).
        about: facts of each building.
    """

    pictures: list[NDArray[np.uint8]]
    places: NDArray[np.int64]
    numbers: NDArray[np.float32]
    sizes: NDArray[np.float32]
    about: list[dict[str, Any]]

    @classmethod
    def load(cls, folder: Path, buildings: int | None = None) -> FrontierSamples:
        """Read the files of a folder.

        Args:
            folder: folder with the files of buildings.
            buildings: number of buildings to read, from the first on; None: all.

        Raises:
            SamplesError: if there are none, or one is damaged or of another format.
        """
        paths = sorted(folder.glob("*.npz"))[:buildings]
        parts = [_building(path) for path in paths]
        if not sum(len(part[1]) for part in parts):
            raise SamplesError(f"{folder} holds no samples of frontiers")
        blocks, ends, numbers, sizes, about = zip(*parts, strict=True)
        places = [
            np.column_stack([np.full(len(end), i), np.append(0, end)[: len(end)], end])
            for i, end in enumerate(ends)
        ]
        return cls(
            list(blocks),
            np.concatenate(places).astype(np.int64),
            np.concatenate(numbers),
            np.concatenate(sizes),
            list(about),
        )

    def __len__(self) -> int:
        return len(self.places)

    def picture(self, index: int) -> NDArray[np.uint8]:
        """Return the picture of a sample, (3, SIDE, SIDE).

        Raises:
            SamplesError: if it is damaged.
        """
        building, begin, end = self.places[index]
        try:
            unpacked = zlib.decompressobj()
            # Limited, since a few bytes may unpack to gigabytes.
            block = unpacked.decompress(
                self.pictures[building][begin:end].tobytes(), 3 * SIDE**2 + 1
            )
            return np.frombuffer(block, dtype=np.uint8).reshape(3, SIDE, SIDE)
        except (zlib.error, ValueError) as error:
            raise SamplesError(f"sample {index} is damaged: {one_line(error)}") from error

    def families(self) -> NDArray[np.str_]:
        """Return the family of the building of each sample, (n,)."""
        return np.array([str(facts["family"]) for facts in self.about])[self.places[:, 0]]

    @property
    def worlds(self) -> frozenset[str]:
        """Hashes of the buildings."""
        return frozenset(str(facts["world"]) for facts in self.about)

    @property
    def digest(self) -> str:
        """SHA-256 of all samples, in hexadecimal."""
        digest = hashlib.sha256(self.places.tobytes())
        digest.update(self.numbers.tobytes() + self.sizes.tobytes())
        for block in self.pictures:
            digest.update(block.tobytes())
        return digest.hexdigest()


def _building(path: Path) -> tuple[Any, ...]:
    """Read the samples of a building: pictures, ends, numbers, sizes, facts."""
    try:
        with np.load(path, allow_pickle=False) as file:
            facts = loads(bytes(file["about"]))
            block, ends, numbers, sizes = (
                file[name] for name in ("pictures", "ends", "numbers", "sizes")
            )
        if not isinstance(facts, dict) or facts.get("format") != FORMAT:
            raise ValueError(f"it is not of format {FORMAT}")
        if "world" not in facts or "family" not in facts:
            raise ValueError("it does not name its building")
        if numbers.shape != (len(ends), GOALS, len(COLUMNS)) or sizes.shape != (len(ends),):
            raise ValueError(f"its numbers are of shape {numbers.shape}")
        if not (numbers.dtype == sizes.dtype == np.float32 and block.dtype == np.uint8):
            raise ValueError(f"its arrays are of {numbers.dtype}, {sizes.dtype}, {block.dtype}")
        if not (np.isfinite(numbers).all() and np.isfinite(sizes).all()):
            raise ValueError("its numbers are not finite")
        return block, ends, numbers, sizes, facts
    except UNREADABLE as error:
        raise SamplesError(
            f"{path} is damaged ({one_line(error)}); delete it and make it again"
        ) from error
