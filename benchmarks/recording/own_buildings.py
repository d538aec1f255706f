"""Buildings of one's own to record training samples in: map files and logs, split by building."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from predictor.data.bags import is_bag
from predictor.data.carmen import ENDINGS
from predictor.data.laser_log import LogError
from predictor.data.survey import REACH, fingerprint, frame_around, read_log
from predictor.infra.command_line import UsageError
from predictor.mapping.grid import world_hash
from sim.map_server import MapError, load_world
from sim.world import World, sealed

MAPS = (".yaml", ".yml")
"""Endings of map files."""
HELD_OUT = 0.25
"""Share of the buildings that are held out for validation."""


@dataclass(frozen=True)
class OwnBuildings:
    """Map files and logs of one's own.

    Attributes:
        train: paths of those to train on.
        validation: paths of those held out for validation.
        hashes: for each split, the hashes of its buildings (of a log: of its files).
        skipped: a line for each file that was left out.
    """

    train: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    hashes: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    skipped: tuple[str, ...] = ()

    @classmethod
    def found(cls, names: tuple[str, ...]) -> OwnBuildings:
        """Read the maps and logs that some names stand for, and split them.

        Files that cannot be read and copies of a building are left out. The buildings are ordered
        by their hashes, and the first `HELD_OUT` of them are held out, so that the split depends
        neither on the names of files nor on their order. A single building is trained on.

        Args:
            names: paths of map files, of logs, and of folders of either.

        Raises:
            UsageError: if a name is neither, or no building can be used.
        """
        paths: dict[str, str] = {}
        skipped = []
        for path in _files(names):
            try:
                one = _hash(path)
            except (MapError, LogError) as error:
                skipped.append(str(error))
                continue
            if one in paths:
                skipped.append(f"{path} is the same building as {paths[one]}")
            else:
                paths[one] = str(path)
        if names and not paths:
            raise UsageError(f"--world: none of its files can be used: {'; '.join(skipped)}")
        hashes = sorted(paths)
        cut = max(1, round(HELD_OUT * len(hashes))) if len(hashes) > 1 else 0
        held, learned = hashes[:cut], hashes[cut:]
        return cls(
            tuple(paths[one] for one in learned),
            tuple(paths[one] for one in held),
            (tuple(learned), tuple(held)),
            tuple(skipped),
        )

    def of(self, split: str) -> tuple[str, ...]:
        """Return the paths of a split."""
        return self.train if split == "train" else self.validation


def is_log(path: Path) -> bool:
    """Return whether a path is that of a log, by its name."""
    return is_bag(path) or path.name.removesuffix(".gz").endswith(ENDINGS)


def building(path: Path) -> World:
    """Read a map file as a building to drive in.

    Raises:
        MapError: if it cannot be read.
    """
    return sealed(load_world(path))


def _hash(path: Path) -> str:
    """Read a map or a log, and return its hash.

    Raises:
        MapError, LogError: if it cannot be read.
    """
    if not is_log(path):
        return world_hash(building(path).grid.cells)
    frame_around(read_log(path).poses, REACH)
    return fingerprint(path)


def _files(names: tuple[str, ...]) -> list[Path]:
    """Return the map files and logs that some names stand for.

    Raises:
        UsageError: if a name stands for none.
    """
    found: list[Path] = []
    for path in map(Path, names):
        if path.is_dir() and not is_bag(path):
            inside = [p for p in sorted(path.iterdir()) if p.suffix in MAPS or is_log(p)]
            if not inside:
                raise UsageError(f"--world: the folder {path} holds neither a .yaml map nor a log")
            found += inside
        elif not path.exists():
            raise UsageError(f"--world: no such file: {path}")
        elif path.suffix in MAPS or is_log(path):
            found.append(path)
        else:
            raise UsageError(
                f"--world: {path} is neither a .yaml map, nor a log ({', '.join(ENDINGS)}, a bag), "
                "nor a folder of such files"
            )
    return found
