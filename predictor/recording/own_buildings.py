"""A user's own buildings for training (`--world`): reading of maps and logs, and their split.

The split is by building, into training and validation; see `OwnBuildings.read`.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from foresee.infra.command_line import UsageError
from foresee.infra.errors import one_line
from foresee.mapping.grid import world_hash
from predictor.data import LOG_FORMATS
from predictor.data.bag_config import BagConfig
from predictor.data.laser_log import LaserLog, LogError
from predictor.data.log_files import is_folder, is_log, read_log
from predictor.data.survey import REACH, frame_around
from sim.buildings import at_sample_resolution, task_in_world
from sim.map_server import MapError, load_world
from sim.task import NoTaskError
from sim.world import World, sealed

MAPS = (".yaml", ".yml")
"""Endings of map files."""
HELD_OUT = 0.25
"""Average share of the buildings that are held out for validation."""


@dataclass(frozen=True)
class Building:
    """The maps and logs of one building.

    Attributes:
        paths: absolute path of each map or log.
        hashes: hash of the contents of each, the cells of a map or the poses and scans of a log.
    """

    paths: tuple[str, ...]
    hashes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of the whole building, of which the split is made."""
        # One for each building: with the lowest of several, more would be held out.
        if len(self.hashes) == 1:
            return self.hashes[0]
        return hashlib.sha256("".join(sorted(self.hashes)).encode()).hexdigest()


@dataclass(frozen=True)
class OwnBuildings:
    """The buildings of `--world`, split into training and validation.

    Attributes:
        train: buildings to train on.
        validation: buildings that are held out for validation.
        skipped: one line for each file that was left out, with the reason.
    """

    train: tuple[Building, ...] = ()
    validation: tuple[Building, ...] = ()
    skipped: tuple[str, ...] = ()

    @classmethod
    def read(cls, names: tuple[str, ...], topics: BagConfig | None = None) -> OwnBuildings:
        """Read the maps and logs that are given, and split them by building.

        Each file counts as one building, except that all files in a subfolder of a given folder
        belong to one building. Files that cannot be read or driven in, and copies, are left out. A
        building is held out if its hash lies below a threshold, so that the split depends neither
        on names nor on other buildings. Of several buildings, however, at least one
        is held out, and at least one is not.

        Args:
            names: paths of map files, of logs, and of folders.
            topics: topics of the bags among them; None: the only ones.

        Raises:
            UsageError: if a path is none of these, or no building can be used.
        """
        seen: dict[str, Path] = {}
        buildings, skipped = [], _too_deep(names)
        for paths in _buildings(names):
            good: dict[str, str] = {}
            for path in paths:
                try:
                    content = _hash(path, topics)
                except (MapError, LogError, NoTaskError) as error:
                    reason = one_line(error)
                    skipped.append(reason if str(path) in reason else f"{path}: {reason}")
                    continue
                if content in seen:
                    skipped.append(f"{path} holds the same as {seen[content]}")
                else:
                    seen[content] = path
                    good[content] = str(path.resolve())
            if good:
                hashes = sorted(good)
                buildings.append(Building(tuple(map(good.__getitem__, hashes)), tuple(hashes)))
        if names and not buildings:
            raise UsageError(f"--world: none of its files can be used: {'; '.join(skipped)}")
        buildings.sort(key=lambda building: building.key)
        held = sum(int(b.key[:8], 16) < HELD_OUT * 16**8 for b in buildings)
        held = min(max(held, 1), len(buildings) - 1) if buildings else 0
        return cls(tuple(buildings[held:]), tuple(buildings[:held]), tuple(skipped))

    def of(self, split: str) -> tuple[Building, ...]:
        """Return the buildings of a split, "train" or "validation"."""
        return self.train if split == "train" else self.validation

    @property
    def hashes(self) -> dict[str, list[list[str]]]:
        """Split → hashes of each of its buildings, plain data for JSON."""
        return {
            split: [list(building.hashes) for building in self.of(split)]
            for split in ("train", "validation")
        }


def read_building(path: Path) -> World:
    """Read a map file as a building to drive in, at the resolution of the samples.

    Raises:
        MapError: if it cannot be read.
    """
    return at_sample_resolution(sealed(load_world(path)))


def log_hash(log: LaserLog) -> str:
    """Return the SHA-256 of a log's poses and ranges."""
    digest = hashlib.sha256(np.ascontiguousarray(log.poses).tobytes())
    for scan in log.scans:
        digest.update(np.ascontiguousarray(scan.ranges).tobytes())
    return digest.hexdigest()


def _hash(path: Path, topics: BagConfig | None) -> str:
    """Read a map or a log, and return its hash.

    Raises:
        MapError, LogError: if it cannot be read.
        NoTaskError: if the car cannot drive anywhere in the map.
    """
    if not is_log(path):
        world = read_building(path)
        task_in_world(world, 0)
        return world_hash(world.grid.cells)
    log = read_log(path, topics)
    frame_around(log.poses, REACH)
    if not any(np.isfinite(scan.ranges).any() for scan in log.scans):
        raise LogError("no scan has a finite range")
    return log_hash(log)


def _buildings(names: tuple[str, ...]) -> list[list[Path]]:
    """Return the map files and logs of each building that some paths name.

    Raises:
        UsageError: if a path names none.
    """
    buildings: list[list[Path]] = []
    for path in map(Path, names):
        if is_folder(path):
            inside = [[file] for file in _files(path)]
            folders = [inner for inner in sorted(path.iterdir()) if is_folder(inner)]
            inside += [files for files in map(_files, folders) if files]
            if not inside:
                raise UsageError(f"--world: the folder {path} holds neither a .yaml map nor a log")
            buildings += inside
        elif not path.exists():
            raise UsageError(f"--world: no such file: {path}")
        elif path.suffix in MAPS or is_log(path):
            buildings.append([path])
        else:
            raise UsageError(
                f"--world: {path} is neither a .yaml map, nor a log, nor a folder of such files; "
                f"logs are {LOG_FORMATS}"
            )
    return buildings


def _too_deep(names: tuple[str, ...]) -> list[str]:
    """Return a line for each folder with maps or logs that lies too deep in the given folders."""
    folders = [path for path in map(Path, names) if is_folder(path)]
    deep = [each for path in folders for each in sorted(path.glob("*/*")) if is_folder(each)]
    why = "it lies too deep: a folder may hold files, and folders of files"
    return [f"{each}: {why}" for each in deep if _files(each)]


def _files(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.iterdir()) if file.suffix in MAPS or is_log(file)]
