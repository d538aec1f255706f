"""Training samples: the observed map at a moment of a drive, and the true map there.

A folder holds one file for each drive, a NumPy archive that is written atomically and read without
running code from it:

    codes     (bytes,) uint8    zlib-compressed samples, one after the other
    ends      (n,) int64        end of each sample in `codes`
    poses     (n, 3) float64    x, y, yaw of the robot in its building [m, m, rad]
    about     (bytes,) uint8    JSON: format, side, family, seed, and the hashes of the building,
                                as driven through (world) and as generated (original)

A sample is (side, side) uint8 of seen + 3 · truth, see `predictor.data.squares`, followed by its
context, (2, CELLS, CELLS) uint8, see `foresee.mapping.context`. The robot is in the middle of
both, facing +x to within 45°: maps are rotated by quarter turns, which need no resampling.
"""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.infra.plain_json import loads
from foresee.infra.resumable import UNREADABLE, as_bytes, write_arrays
from foresee.mapping.context import CELLS, context_of
from foresee.mapping.conventions import CROP_CELLS
from foresee.mapping.grid import Grid
from predictor.data.squares import Square, codes_of, joined, middle, parted

FORMAT = 3
RECIPE = "recipe.json"
"""Name of the file, beside the folders of the splits, with the settings that samples were made
with."""
SIDE = 280
"""Side of a sample [cells]: 14 m at 0.05 m, as much as a car with a top speed of 4 m/s can use."""


class SamplesError(LineError):
    """A folder or file holds no readable samples; the message is one line."""


def quarters(yaw: float) -> int:
    """Return how many turns of `numpy.rot90` bring a heading [rad] to within 45° of +x."""
    return round(yaw / (0.5 * np.pi)) % 4


def encoded(known: Grid, truth: NDArray[np.uint8], around: Grid, yaw: float) -> bytes:
    """Return one sample, compressed.

    Args:
        known: map of all that was observed, (SIDE, SIDE).
        truth: codes of the true map there, (SIDE, SIDE).
        around: map of all that was observed in the square of the context.
        yaw: heading of the robot [rad].
    """
    turns = quarters(yaw)
    codes = np.rot90(joined(codes_of(known.cells), truth), turns)
    context = np.rot90(context_of(around), turns, axes=(1, 2))
    return zlib.compress(codes.tobytes() + context.tobytes(), 2)


def write_samples(
    path: Path, samples: list[tuple[bytes, NDArray[np.float64]]], about: dict[str, Any]
) -> None:
    """Write the samples of a drive, whole or not at all.

    Args:
        path: path of the file.
        samples: each as `encoded` makes it, with the pose of the robot, (3,).
        about: facts of the drive.
    """
    arrays: dict[str, NDArray[Any]] = {
        "codes": np.frombuffer(b"".join(sample for sample, _ in samples), dtype=np.uint8),
        "ends": np.cumsum([len(sample) for sample, _ in samples], dtype=np.int64),
        "poses": np.array([pose for _, pose in samples], dtype=np.float64).reshape(-1, 3),
        "about": as_bytes({"format": FORMAT, "side": SIDE} | about),
    }
    write_arrays(path, arrays, compress=False)


@dataclass(frozen=True, eq=False)
class Samples:
    """All samples of a folder, held compressed in memory.

    Attributes:
        codes: bytes of all samples of each drive, compressed.
        starts: drive of each sample, and its begin and end in the bytes of that drive, (n, 3).
        about: facts of each drive.
    """

    codes: list[NDArray[np.uint8]]
    starts: NDArray[np.int64]
    about: list[dict[str, Any]]

    @classmethod
    def load(cls, folder: Path, drives: int | None = None) -> Samples:
        """Read a folder.

        Args:
            folder: folder with the files of drives.
            drives: number of drives to read, from the first on; None: all.

        Raises:
            SamplesError: if there are no samples, a drive between others is missing, or a file is
                damaged or of another format.
        """
        paths = sorted(folder.glob("*.npz"))[:drives] if folder.is_dir() else []
        if not paths:
            raise SamplesError(f"{folder} holds no samples: python -m predictor.drives makes some")
        numbers = [int(path.stem) for path in paths if path.stem.isdecimal()]
        lost = max(numbers) - min(numbers) + 1 - len(numbers) if numbers else 0
        if lost:
            raise SamplesError(
                f"{folder} misses {lost} of its drives: give the command that makes them again"
            )
        codes, starts, about = [], [], []
        for drive, path in enumerate(paths):
            try:
                block, ends, facts = _drive(path)
            except SamplesError:
                raise
            except UNREADABLE as error:
                raise SamplesError(
                    f"{path} is damaged ({one_line(error)}); delete it and make it again"
                ) from error
            codes.append(block)
            about.append(facts)
            begin = np.concatenate([[0], ends])[: len(ends)].astype(np.int64)
            starts.append(np.column_stack([np.full(len(ends), drive), begin, ends]))
        if not sum(len(part) for part in starts):
            raise SamplesError(f"{folder} holds drives without a single sample: make more drives")
        return cls(codes, np.concatenate(starts), about)

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: int) -> NDArray[np.uint8]:
        """Return the codes of a sample, (SIDE, SIDE).

        Raises:
            SamplesError: if they are damaged.
        """
        return self.with_context(index)[0]

    def with_context(self, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return the codes of a sample (SIDE, SIDE), and its context (2, CELLS, CELLS).

        Raises:
            SamplesError: if they are damaged.
        """
        drive, begin, end = self.starts[index]
        try:
            # Limited, since a few bytes may unpack to gigabytes.
            unpacked = zlib.decompressobj()
            size = SIDE**2 + 2 * CELLS**2
            block = unpacked.decompress(self.codes[drive][begin:end].tobytes(), size + 1)
            codes, context = np.split(np.frombuffer(block, dtype=np.uint8), [SIDE**2])
            codes, context = codes.reshape(SIDE, SIDE), context.reshape(2, CELLS, CELLS)
            if codes.max() > 8 or context.max() > 100 or not unpacked.eof:
                raise ValueError("it holds other than codes and percentages")
            return codes, context
        except (zlib.error, ValueError) as error:
            seed = self.about[drive].get("seed")
            raise SamplesError(
                f"sample {index}, of the drive of seed {seed}, is damaged: {error}"
            ) from error

    def square(self, index: int, expansion: float) -> Square:
        """Return the middle of a sample, `expansion` times as wide as 5 m.

        Samples were seen through windows of 5 m and more; the crop is the 5 m in their middle.

        Raises:
            SamplesError: if the sample is damaged.
        """
        seen, truth = parted(self[index])
        return Square.of(
            middle(seen, CROP_CELLS), seen, middle(truth, round(CROP_CELLS * expansion))
        )

    @cached_property
    def _families(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(sorted({_family(facts) for facts in self.about}))}

    @property
    def families(self) -> int:
        """Number of families of buildings; all maps of one's own count as one."""
        return len(self._families)

    def family(self, index: int) -> int:
        """Return the number of the family of a sample's building."""
        return self._families[_family(self.about[self.starts[index][0]])]

    @property
    def worlds(self) -> frozenset[str]:
        """Hashes of the buildings, as driven through and as generated."""
        return frozenset(str(facts[key]) for facts in self.about for key in ("world", "original"))

    @property
    def digest(self) -> str:
        """SHA-256 of all samples, in hexadecimal."""
        digest = hashlib.sha256(self.starts.tobytes())
        for block in self.codes:
            digest.update(block.tobytes())
        return digest.hexdigest()


def _family(facts: dict[str, Any]) -> str:
    """Return the family of a drive's building, or "map" or "log" for one's own."""
    return str(facts.get("family", ""))


def _drive(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.int64], dict[str, Any]]:
    """Read the compressed samples of a drive, the end of each sample in them, and the facts."""
    with np.load(path, allow_pickle=False) as file:
        facts, block, ends = loads(bytes(file["about"])), file["codes"], file["ends"]
    if not isinstance(facts, dict):
        raise ValueError("its facts (about) are no JSON object")
    if facts.get("format") != FORMAT or facts.get("side") != SIDE:
        raise SamplesError(
            f"{path} is of format {facts.get('format')}, not {FORMAT}: make new samples in another "
            "folder"
        )
    if block.dtype != np.uint8 or block.ndim != 1:
        raise ValueError(f"codes are {block.dtype} {block.shape}, they must be bytes")
    if ends.dtype.kind not in "iu" or ends.ndim != 1:
        raise ValueError(f"ends are {ends.dtype} {ends.shape}, they must be whole numbers")
    if len(ends) and (ends[-1] > len(block) or ends[0] <= 0 or (np.diff(ends) <= 0).any()):
        raise ValueError("ends do not increase, or lie beyond the codes")
    if "world" not in facts or "original" not in facts:
        raise ValueError("it does not name its building")
    return block, ends.astype(np.int64), facts
