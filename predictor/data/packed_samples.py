"""Sets of packed samples: a folder with a NumPy archive for each drive or building.

An archive is written atomically and read without running code from it:

    NAME      (bytes,) uint8    zlib-compressed samples, one after the other
    ends      (n,) int64        end of each sample in these bytes
    about     (bytes,) uint8    JSON: format and seed, and the hash of the building
    …         (n, …)            further arrays, with an entry for each sample
"""

from __future__ import annotations

import hashlib
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError, one_line
from foresee.infra.part_file import Part, read_part, write_part

MOST_BYTES = 2**30
"""Largest size of the arrays of a file [bytes]; those of a drive have a few MB."""


class SamplesError(LineError):
    """A folder or file holds no readable samples; the message is one line."""


@dataclass(frozen=True, eq=False)
class PackedSamples:
    """All samples of a folder.

    Attributes:
        NAME: name of the packed samples in a file.
        HEAD: facts that all files have in common: the format.
        NEEDED: further facts of each file.
        SIZE: size of an unpacked sample [bytes].
        ARRAYS: further arrays of a file that are read, and the shape of an entry; of float32.
        COMMAND: command that makes the samples.
        blocks: packed samples of each drive.
        places: drive of each sample, and its begin and end in the block of that drive, (n, 3).
        about: facts of each drive.
        arrays: further arrays by name, (n, …).
    """

    NAME: ClassVar[str]
    HEAD: ClassVar[dict[str, int]]
    NEEDED: ClassVar[tuple[str, ...]]
    SIZE: ClassVar[int]
    ARRAYS: ClassVar[dict[str, tuple[int, ...]]]
    COMMAND: ClassVar[str]
    blocks: list[NDArray[np.uint8]]
    places: NDArray[np.int64]
    about: list[dict[str, Any]]
    arrays: dict[str, NDArray[np.float32]]

    @classmethod
    def load(cls, folder: Path, drives: int | None = None) -> Self:
        """Read a folder.

        Args:
            folder: folder with the files of drives or buildings.
            drives: number of files to read, from the first on; None: all.

        Raises:
            SamplesError: if there are no samples, fewer files than `drives`, a drive between others
                is missing, or a file is damaged or of another format.
        """
        paths = sorted(folder.glob("*.npz"))[:drives] if folder.is_dir() else []
        if not paths:
            raise SamplesError(f"{folder} holds no samples: python -m {cls.COMMAND} makes some")
        if drives is not None and len(paths) < drives:
            raise SamplesError(
                f"{folder} holds {len(paths)} of {drives} drives: give the command that makes them "
                "again"
            )
        numbers = [int(path.stem) for path in paths if path.stem.isdecimal()]
        lost = max(numbers) - min(numbers) + 1 - len(numbers) if numbers else 0
        if lost:
            raise SamplesError(
                f"{folder} misses {lost} of its drives: give the command that makes them again"
            )
        about, files = zip(*map(cls._read, paths), strict=True)
        ends = [file["ends"].astype(np.int64) for file in files]
        if not sum(map(len, ends)):
            raise SamplesError(f"{folder} holds drives without a single sample: make more drives")
        places = [
            np.column_stack([np.full(len(end), drive), np.append(0, end)[:-1], end])
            for drive, end in enumerate(ends)
        ]
        return cls(
            [file[cls.NAME] for file in files],
            np.concatenate(places),
            list(about),
            {name: np.concatenate([file[name] for file in files]) for name in cls.ARRAYS},
        )

    @classmethod
    def write(
        cls, path: Path, packed: list[bytes], about: dict[str, Any], **arrays: NDArray[Any]
    ) -> None:
        """Write the samples of a drive, whole or not at all.

        Args:
            path: path of the file.
            packed: samples, compressed by zlib.
            about: facts of the drive.
            arrays: further arrays by name.
        """
        block = np.frombuffer(b"".join(packed), dtype=np.uint8)
        ends = np.cumsum([len(sample) for sample in packed], dtype=np.int64)
        arrays = {cls.NAME: block, "ends": ends, **arrays}
        write_part(path, cls.HEAD | about, arrays, "about", compress=False)

    def __len__(self) -> int:
        return len(self.places)

    def unpacked(self, index: int, most: int) -> NDArray[np.uint8]:
        """Return the bytes of a sample, (SIZE,).

        Args:
            index: number of the sample.
            most: largest value that a byte may have.

        Raises:
            SamplesError: if they are damaged.
        """
        drive, begin, end = self.places[index]
        try:
            # Limited, since a few bytes may unpack to gigabytes.
            unpacking = zlib.decompressobj()
            data = unpacking.decompress(self.blocks[drive][begin:end].tobytes(), self.SIZE + 1)
            values = np.frombuffer(data, dtype=np.uint8)
            if len(values) != self.SIZE or not unpacking.eof or values.max() > most:
                raise ValueError("it has another size, or other values")
            return values
        except (zlib.error, ValueError) as error:
            seed = self.about[drive].get("seed")
            raise SamplesError(
                f"sample {index}, of the drive of seed {seed}, is damaged: {error}"
            ) from error

    def stacked(self, chosen: NDArray[np.integer[Any]], most: int) -> NDArray[np.uint8]:
        """Return the bytes of some samples, (n, SIZE).

        Args:
            chosen: numbers of the samples, (n,).
            most: largest value that a byte may have.

        Raises:
            SamplesError: if one is damaged.
        """
        out = np.empty((len(chosen), self.SIZE), dtype=np.uint8)

        def unpack(row: int) -> None:
            out[row] = self.unpacked(int(chosen[row]), most)

        # In threads, since zlib releases the interpreter's lock.
        with ThreadPoolExecutor() as threads:
            list(threads.map(unpack, range(len(chosen))))
        return out

    @cached_property
    def families(self) -> list[str]:
        """Names of the families of buildings; one's own maps, and logs, count as one each."""
        return sorted({_family(facts) for facts in self.about})

    @cached_property
    def family_numbers(self) -> NDArray[np.int64]:
        """Number, in `families`, of the family of each sample's building, (n,)."""
        numbers = [self.families.index(_family(facts)) for facts in self.about]
        return np.array(numbers, dtype=np.int64)[self.places[:, 0]]

    @property
    def worlds(self) -> frozenset[str]:
        """Hashes of the buildings, as driven through and as generated."""
        keys = ("world", "original")
        return frozenset(str(facts[key]) for facts in self.about for key in keys if key in facts)

    @property
    def digest(self) -> str:
        """SHA-256 of all samples, in hexadecimal."""
        digest = hashlib.sha256(self.places.tobytes())
        for values in self.arrays.values():
            digest.update(values.tobytes())
        for block in self.blocks:
            digest.update(block.tobytes())
        return digest.hexdigest()

    @classmethod
    def _read(cls, path: Path) -> Part:
        """Read the facts of a file, and its arrays by name."""
        try:
            facts, arrays = read_part(path, "about", MOST_BYTES)
            if not cls.HEAD.items() <= facts.items():
                raise SamplesError(
                    f"{path} is of format {facts.get('format')}, not {cls.HEAD['format']}: make "
                    "new samples in another folder"
                )
            if not set(cls.NEEDED) <= facts.keys():
                raise ValueError("it does not name its building")
            block, ends = arrays[cls.NAME], arrays["ends"]
            if block.dtype != np.uint8 or block.ndim != 1:
                raise ValueError(f"{cls.NAME} are {block.dtype} {block.shape}, not bytes")
            if ends.dtype.kind not in "iu" or ends.ndim != 1:
                raise ValueError(f"ends are {ends.dtype} {ends.shape}, not whole numbers")
            if len(ends) and (ends[-1] > len(block) or ends[0] <= 0 or (np.diff(ends) <= 0).any()):
                raise ValueError("ends do not increase, or lie beyond the bytes")
            for name, shape in cls.ARRAYS.items():
                values = arrays[name]
                if values.dtype != np.float32 or values.shape != (len(ends), *shape):
                    raise ValueError(f"{name} are {values.dtype} {values.shape}")
                if not np.isfinite(values).all():
                    raise ValueError(f"{name} are not finite")
            return facts, arrays
        except SamplesError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SamplesError(
                f"{path} is damaged ({one_line(error)}); delete it and make it again"
            ) from error


def _family(facts: dict[str, Any]) -> str:
    """Return the family of a drive's building, or "map" or "log" for one's own."""
    return str(facts.get("family", ""))
