"""Recording of trajectories, and their writing into the folder of a data set."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.atomic_file import write_whole
from foresee.infra.environment import commit, own_version
from foresee.infra.part_file import write_arrays
from foresee.infra.resumable import ResumableFolder, refuse_other_settings
from foresee.mapping.conventions import CROP_CELLS, RESOLUTION
from foresee.mapping.grid import GridFrame, OccupancyGrid
from predictor.data.frames import (
    ARRAYS,
    FORMAT,
    LARGEST_FILE,
    MANIFEST,
    SIDE,
    FramesError,
    checksum,
    read_manifest,
)
from predictor.data.samples import RECIPE
from predictor.data.squares import encode_cells, middle

WINDOW = 5.0
"""Side of the window around the car, inside which scans change the map `near` [m]."""


class FrameSet:
    """The folder of a data set that is being made.

    The manifest is written after each trajectory, so that the next run continues if the process was
    killed. A later run may add or leave out trajectories.

    Args:
        folder: folder of the set; made if it is missing.
        kind: "simulated" or "physical".
        settings: all that decides the frames except the logs.
        names: names of the trajectories that belong to the set, in order.
        sources: fingerprints of the logs that trajectories are made from; a trajectory made from
            another log counts as missing.

    Raises:
        UsageError: if the folder holds a set of another kind or with other settings, or cannot be
            used.
        FramesError: if it holds samples, or a damaged manifest.
    """

    def __init__(
        self,
        folder: Path,
        kind: str,
        settings: dict[str, Any],
        names: list[str],
        sources: dict[str, str] | None = None,
    ) -> None:
        self.folder, self.names, self.sources = folder, names, sources or {}
        if (folder / RECIPE).exists():
            raise FramesError(f"{folder} holds samples of predictor.drives: choose another folder")
        ResumableFolder(folder)
        self._facts = {
            "format": FORMAT,
            "kind": kind,
            "version": own_version(),
            "settings": settings,
            "planned": len(names),
        }
        self.done: dict[str, dict[str, Any]] = {}
        if (folder / MANIFEST).exists():
            manifest = read_manifest(folder)
            kept = {Path(facts["file"]).stem: facts for facts in manifest["trajectories"]}
            if kept:
                earlier = manifest.get("settings")
                earlier = earlier if isinstance(earlier, dict) else {"settings": earlier}
                earlier |= {"kind": manifest.get("kind")}
                refuse_other_settings(folder, {"kind": kind} | settings, earlier)
            self.done = {name: kept[name] for name in names if self._is_whole(name, kept)}
            self._write()

    @property
    def missing(self) -> list[str]:
        """Names of the trajectories that are not made yet."""
        return [name for name in self.names if name not in self.done]

    def add(self, name: str, facts: dict[str, Any]) -> None:
        """Add a trajectory, whose file is written, to the manifest."""
        source = {"source": self.sources[name]} if name in self.sources else {}
        self.done[name] = facts | source
        self._write()

    def _is_whole(self, name: str, kept: dict[str, dict[str, Any]]) -> bool:
        facts = kept.get(name)
        if facts is None or facts.get("source") != self.sources.get(name):
            return False
        path = self.folder / facts["file"]
        return path.is_file() and checksum(path, LARGEST_FILE) == facts["sha256"]

    def _write(self) -> None:
        entries = [self.done[name] for name in self.names if name in self.done]
        text = json.dumps(self._facts | {"trajectories": entries}, indent=1)
        write_whole(self.folder / MANIFEST, text.encode())


class Recording:
    """The frames of one trajectory, collected one by one.

    Args:
        frame: where the building's map lies.
        truth: codes of the building's true map, (rows, columns).
    """

    def __init__(self, frame: GridFrame, truth: NDArray[np.uint8]) -> None:
        self.frame, self.truth = frame, truth
        self._rows: dict[str, list[NDArray[Any]]] = {name: [] for name in ARRAYS}

    def __len__(self) -> int:
        return len(self._rows["times"])

    def add(
        self,
        whole: OccupancyGrid,
        near: OccupancyGrid,
        state: NDArray[np.float64],
        action: NDArray[np.float64],
        time: float,
    ) -> None:
        """Add a frame.

        Args:
            whole: map of all that the LIDAR has observed so far.
            near: map of what it has observed so far within its window.
            state: x, y [m], yaw [rad], v [m/s], (4,).
            action: acceleration [m/s²], curvature [1/m], (2,).
            time: time of the frame [s].
        """
        square = self.frame.square(float(state[0]), float(state[1]), SIDE * RESOLUTION)
        row = {
            "estimated": middle(encode_cells(whole.crop(square).cells), CROP_CELLS),
            "remembered": encode_cells(near.crop(square).cells),
            "states": state,
            "actions": action,
            "times": time,
            "corners": self.frame.offset(square),
        }
        for name, value in row.items():
            self._rows[name].append(np.array(value, dtype=ARRAYS[name][0]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays of a trajectory's file."""
        return {name: np.stack(values) for name, values in self._rows.items()} | {
            "map": self.truth,
            "origin": np.array(self.frame.origin),
        }


def write_trajectory(
    folder: Path, name: str, arrays: dict[str, NDArray[Any]], about: dict[str, Any]
) -> dict[str, Any]:
    """Write a trajectory's file, and return its facts for the manifest.

    Args:
        folder: folder of the set.
        name: name of the file without its ending.
        arrays: all arrays of the file, see `predictor.data.frames`.
        about: split, map, world and other facts.
    """
    path = folder / f"{name}.npz"
    write_arrays(path, arrays)
    made = {"count": len(arrays["states"]), "commit": commit(), "sha256": checksum(path)}
    return {"file": path.name} | about | made
