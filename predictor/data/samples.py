"""Training samples: the observed map at a moment of a drive, and the true map there.

A folder holds one file for each drive, see `predictor.data.packed_samples`:

    codes     packed samples
    poses     (n, 3) float64: x, y, yaw of the robot in its building [m, m, rad]
    about     format, side, family, seed, and the hashes of the building, as driven through (world)
              and as generated (original)

A sample is (side, side) uint8 of seen + 3 · truth, see `predictor.data.squares`, followed by its
context, (2, CELLS, CELLS) uint8, see `foresee.mapping.context`. The robot is in the middle of both,
facing +x to within 45°: maps are rotated by quarter turns, which need no resampling.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from foresee.mapping.context import CELLS, coarse_context
from foresee.mapping.conventions import CROP_CELLS
from foresee.mapping.grid import Grid
from predictor.data.packed_samples import PackedSamples, SamplesError
from predictor.data.squares import Square, encode_cells, joined, middle, parted

if TYPE_CHECKING:
    from torch import Tensor

Bytes = TypeVar("Bytes", NDArray[np.uint8], "Tensor")

FORMAT = 5
PLANNED = "planned.json"
"""File in the folder of a set with the number of drives of each split that were asked for."""
RECIPE = "recipe.json"
"""Name of the file, beside the folders of the splits, with the settings that samples were made
with."""
SIDE = 280
"""Side of a sample [cells]: 14 m at 0.05 m, as much as a car with a top speed of 4 m/s can use."""


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
    codes = np.rot90(joined(encode_cells(known.cells), truth), turns)
    context = np.rot90(coarse_context(around), turns, axes=(1, 2))
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
    poses = np.array([pose for _, pose in samples], dtype=np.float64).reshape(-1, 3)
    Samples.write(path, [sample for sample, _ in samples], about, poses=poses)


class Samples(PackedSamples):
    """All samples of a folder, held compressed in memory."""

    NAME, NEEDED, COMMAND = "codes", ("world", "original"), "predictor.drives"
    ARRAYS: ClassVar = {}
    HEAD: ClassVar = {"format": FORMAT, "side": SIDE}
    SIZE = SIDE**2 + 2 * CELLS**2

    def __getitem__(self, index: int) -> NDArray[np.uint8]:
        """Return the codes of a sample, (SIDE, SIDE).

        Raises:
            SamplesError: if they are damaged.
        """
        codes, _ = self.parts(self.unpacked(index, 100))
        if codes.max() > 8:
            raise SamplesError(f"sample {index} is damaged: it holds codes above 8")
        return codes

    def stacked(self, chosen: NDArray[np.integer[Any]], most: int) -> NDArray[np.uint8]:
        """Return the bytes of some samples, (n, SIZE).

        Args:
            chosen: numbers of the samples, (n,).
            most: largest value that a byte may have; codes may be 8 at most.

        Raises:
            SamplesError: if one is damaged.
        """
        data = super().stacked(chosen, most)
        # Higher codes would be indices beyond the tables of the training.
        damaged = chosen[data[:, : SIDE**2].max(axis=1) > 8]
        if len(damaged):
            raise SamplesError(f"sample {damaged[0]} is damaged: it holds codes above 8")
        return data

    @staticmethod
    def parts(data: Bytes) -> tuple[Bytes, Bytes]:
        """Return the codes and the contexts of samples.

        Args:
            data: bytes of the samples, (…, SIZE).

        Returns:
            Codes (…, SIDE, SIDE), and contexts (…, 2, CELLS, CELLS).
        """
        codes, coarse = data[..., : SIDE**2], data[..., SIDE**2 :]
        return (
            codes.reshape(*codes.shape[:-1], SIDE, SIDE),
            coarse.reshape(*coarse.shape[:-1], 2, CELLS, CELLS),
        )

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
