"""Frames of a data set: what was observed around the car at each tick, and what is true there.

The data of Katyal et al. 2018, on disk and in memory. A set is a folder:

    manifest.json       what the set is, and each trajectory: file, split, count, checksum …
    NAME.npz            one for each trajectory, of n frames:
        estimated       (n, 100, 100) uint8     5 m square as observed by the whole LIDAR: the
                                                paper's input
        remembered      (n, 200, 200) uint8     10 m square as observed by a LIDAR that is used
                                                within a 5 m window only
        states          (n, 4) float64          x, y [m], yaw [rad], v [m/s]
        actions         (n, 2) float64          acceleration [m/s²], curvature [1/m]
        times           (n,) float64            [s]
        map             (rows, columns) uint8   the truth of the whole building
        origin          (2,) float64            x, y of the map's lower-left corner [m]
        corners         (n, 2) int32            row and column in `map` of the 10 m square's cell
                                                (0, 0); what lies outside the map is 2

Cells are 0.05 m; row = y, column = x; `predictor.data.squares` explains the codes. All squares are
centred on the car and parallel to the axes, as in the paper. Values that were not recorded are NaN.

`predictor.data.frame_set` writes sets, `predictor.dataset` makes them; docs/reference/files.md
describes the format.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import LineError
from foresee.infra.input_file import check_input
from foresee.infra.plain_json import read_object
from foresee.infra.plain_npz import NpzError, PlainNpz, read_npz
from foresee.mapping.conventions import CROP_CELLS
from predictor.data.squares import NOTHING, Square

FORMAT = 1
MANIFEST = "manifest.json"
SIDE = 2 * CROP_CELLS
"""Side of the largest square [cells]: 10 m."""
ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "estimated": ("|u1", (CROP_CELLS, CROP_CELLS)),
    "remembered": ("|u1", (SIDE, SIDE)),
    "states": ("<f8", (4,)),
    "actions": ("<f8", (2,)),
    "times": ("<f8", ()),
    "corners": ("<i4", (2,)),
}
"""Arrays of a trajectory's file with one entry for each frame: type and shape of an entry."""
ROWS = ("states", "actions", "times", "corners")
"""Arrays that `Frames.load` reads at once; the others are images, which are read on access."""
LARGEST_FILE, LARGEST_IMAGES = 2**33, 2**31
"""Largest file of a trajectory that is read, and largest array of images in it [bytes]: those of
53 000 frames."""
NEEDED = dict.fromkeys(("file", "split", "map", "world", "sha256"), str) | {"count": int}
"""Facts that the manifest must give of a trajectory, with their types."""


class FramesError(LineError):
    """A folder holds no readable frames, or not those asked for; the message is one line."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a set, or of one split of it.

    The images are read on first access: 50 kB per frame in memory, 2 kB on disk.

    Attributes:
        folder: folder of the set.
        about: facts of each trajectory from the manifest: split, map, seed, count, `world` (the
            building's hash), and more.
        trajectory: number of the trajectory that each frame belongs to, (n,).
        states: x, y [m], yaw [rad], v [m/s], (n, 4).
        actions: acceleration [m/s²], curvature [1/m], (n, 2).
        times: time since the beginning of the trajectory or log, (n,) [s].
        corners: row and column of each frame's 10 m square in the map of its building, (n, 2).
        maps: true map of each trajectory's building, (rows, columns) codes.
        origins: x, y of the lower-left corner of each of these maps, (trajectories, 2) [m].
    """

    folder: Path
    about: list[dict[str, Any]]
    trajectory: NDArray[np.intp]
    states: NDArray[np.float64]
    actions: NDArray[np.float64]
    times: NDArray[np.float64]
    corners: NDArray[np.int32]
    maps: list[NDArray[np.uint8]]
    origins: NDArray[np.float64]

    @classmethod
    def load(cls, folder: Path, split: str | None = None) -> Frames:
        """Read and check a set; the codes of the images are checked when they are read.

        Args:
            folder: folder with the manifest.
            split: split whose trajectories are read; None: all.

        Raises:
            FramesError: if there is no set, it is unfinished, damaged or of another format, or
                has no such split.
        """
        manifest = read_manifest(folder)
        about, planned = manifest["trajectories"], manifest["planned"]
        if not about or len(about) < planned:
            raise FramesError(
                f"{folder} is unfinished, it has {len(about)} of {planned} trajectories: give the "
                "command that began it again"
            )
        if split is not None:
            splits = sorted({facts["split"] for facts in about})
            about = [facts for facts in about if facts["split"] == split]
            if not about:
                raise FramesError(f"{folder} has no split {split!r}: it has {', '.join(splits)}")
        parts = [_read(folder / facts["file"], facts) for facts in about]
        counts = [facts["count"] for facts in about]
        return cls(
            folder=folder,
            about=about,
            trajectory=np.repeat(np.arange(len(about), dtype=np.intp), counts),
            maps=[part["map"] for part in parts],
            origins=np.array([part["origin"] for part in parts]),
            **{name: np.concatenate([part[name] for part in parts]) for name in ROWS},
        )

    def __len__(self) -> int:
        return len(self.trajectory)

    @cached_property
    def estimated(self) -> NDArray[np.uint8]:
        """Codes of the 5 m square, as observed by the whole LIDAR so far, (n, 100, 100)."""
        return self._images("estimated")

    @cached_property
    def remembered(self) -> NDArray[np.uint8]:
        """Codes of the 10 m square, (n, 200, 200), as observed within the 5 m window so far."""
        return self._images("remembered")

    def truth(self, index: Any, expansion: float) -> NDArray[np.uint8]:
        """Return the true square that is `expansion` times as wide as 5 m, (..., side, side) codes.

        Args:
            index: number of a frame, or a slice or array of several.
            expansion: 1.0 to 2.0 in steps of 0.02, so that the square has a middle.

        Raises:
            FramesError: if there is no such square.
        """
        side = round(CROP_CELLS * expansion)
        if side % 2 or not CROP_CELLS <= side <= SIDE or abs(side - CROP_CELLS * expansion) > 1e-6:
            raise FramesError(f"expansion is {expansion}, it must be 1.00, 1.02, … or 2.00")
        chosen = np.arange(len(self))[index]
        out = np.empty((*chosen.shape, side, side), dtype=np.uint8)
        inset = (SIDE - side) // 2
        for place, frame in np.ndenumerate(chosen):
            row, col = self.corners[frame] + SIDE + inset
            out[place] = self._padded[self.trajectory[frame]][row : row + side, col : col + side]
        return out

    def square(self, index: int, expansion: float) -> Square:
        """Return the square around a frame that is `expansion` times as wide as 5 m.

        Raises:
            FramesError: if there is no such square.
        """
        return Square.of(
            self.estimated[index], self.remembered[index], self.truth(index, expansion)
        )

    def alone(self, number: int) -> Frames:
        """Return the frames of one trajectory; only its images are read on access."""
        of_it = self.trajectory == number
        return Frames(
            folder=self.folder,
            about=[self.about[number]],
            maps=[self.maps[number]],
            trajectory=np.zeros(of_it.sum(), dtype=np.intp),
            origins=self.origins[number : number + 1],
            **{name: getattr(self, name)[of_it] for name in ROWS},
        )

    @property
    def worlds(self) -> frozenset[str]:
        """Hashes of the buildings."""
        return frozenset(facts["world"] for facts in self.about)

    @property
    def digest(self) -> str:
        """SHA-256 of the files of all trajectories, in hexadecimal."""
        files = "".join(facts["sha256"] for facts in self.about)
        return hashlib.sha256(files.encode()).hexdigest()

    @cached_property
    def _padded(self) -> list[NDArray[np.uint8]]:
        # A square may reach beyond the map by at most its own side.
        return [np.pad(cells, SIDE, constant_values=NOTHING) for cells in self.maps]

    def _images(self, name: str) -> NDArray[np.uint8]:
        out = np.empty((len(self), *ARRAYS[name][1]), dtype=np.uint8)
        at = 0
        for facts in self.about:
            path = self.folder / facts["file"]
            try:
                with PlainNpz(path) as file:
                    images = file.read(name, LARGEST_IMAGES)
            except (OSError, NpzError) as error:
                raise _damaged(path, str(error)) from error
            if images.shape != (facts["count"], *out.shape[1:]) or images.max(initial=0) > NOTHING:
                raise _damaged(path, f"{name} holds codes other than 0, 1, 2")
            out[at : at + len(images)] = images
            at += len(images)
        return out


def checksum(path: Path, most: int = 2**40) -> str:
    """Return the SHA-256 of a file, in hexadecimal.

    Args:
        path: path of the file.
        most: largest size allowed [bytes].

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no regular file, or too large.
    """
    check_input(path, most)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a set, finished or not.

    Raises:
        FramesError: if there is none, or it is no manifest of this format.
    """
    path = folder / MANIFEST
    try:
        manifest = read_object(path)
    except (FileNotFoundError, NotADirectoryError):
        raise FramesError(
            f"{folder} holds no data set, for there is no {MANIFEST}: "
            "python -m predictor.dataset makes one"
        ) from None
    except (OSError, ValueError) as error:
        raise FramesError(f"{path} cannot be read: {error}") from error
    if "format" not in manifest:
        raise FramesError(f"{path} is no manifest of a data set: it has no format")
    if manifest["format"] != FORMAT:
        raise FramesError(
            f"{folder} is of format {manifest['format']}, this version reads "
            f"{FORMAT}: make it again in another folder"
        )
    entries = manifest.get("trajectories")
    if not isinstance(entries, list) or not isinstance(manifest.get("planned"), int):
        raise FramesError(f"{path} is broken: 'planned' or 'trajectories' is missing")
    for number, facts in enumerate(entries):
        for key, kind in NEEDED.items():
            if not isinstance(facts, dict) or not isinstance(facts.get(key), kind):
                raise FramesError(f"{path} is broken: trajectory {number} has no proper {key!r}")
        # The manifest must not name files outside of the folder.
        if Path(facts["file"]).name != facts["file"] or facts["count"] < 1:
            raise FramesError(f"{path} is broken: trajectory {number} has an odd file or count")
    return manifest


def _read(path: Path, facts: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Read a trajectory without its images, of which only types and shapes are checked."""
    try:
        present = path.is_file()
    except OSError:  # A name that is too long.
        present = False
    if not present:
        raise FramesError(f"{path} is missing: the command that made the set makes it again")
    try:
        if checksum(path, LARGEST_FILE) != facts["sha256"]:
            raise ValueError("its checksum is another than the manifest's")
        part = read_npz(path, names=(*ROWS, "map", "origin"))
        with PlainNpz(path) as file:
            heads = {name: file.head(name, LARGEST_IMAGES) for name in ARRAYS}
    except (OSError, ValueError) as error:
        raise _damaged(path, str(error)) from error
    for name, (kind, shape) in ARRAYS.items():
        wanted = kind, (facts["count"], *shape)
        has = heads[name].dtype.str, heads[name].shape
        if has != wanted:
            raise _damaged(path, f"{name} is {has}, not {wanted}")
    cells, origin, corners = part["map"], part["origin"], part["corners"]
    if cells.ndim != 2 or cells.dtype != np.uint8 or cells.max(initial=0) > NOTHING:
        raise _damaged(path, "its map is not a 2-D array of codes 0, 1, 2")
    if origin.shape != (2,) or origin.dtype.kind != "f" or not np.isfinite(origin).all():
        raise _damaged(path, "the origin of its map is missing or not finite")
    if not np.isfinite(part["states"][:, :3]).all():
        raise _damaged(path, "poses are missing or not finite")
    if (corners < -SIDE).any() or (corners > np.array(cells.shape)).any():
        raise _damaged(path, "frames lie outside their map")
    return part


def _damaged(path: Path, why: str) -> FramesError:
    line = why.splitlines()[0] if why else "it cannot be read"
    return FramesError(
        f"{path} is damaged ({line}): delete it and give the command that made the set again"
    )
