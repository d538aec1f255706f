"""Writing a data set: one trajectory after the other, each whole or not at all."""

from __future__ import annotations

import io
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor.data.frames import FORMAT, MANIFEST, FramesError, checksum, read_manifest
from predictor.data.samples import RECIPE
from predictor.whole import write_whole


class FrameSet:
    """The folder of a set that is being made.

    The manifest is there from the beginning, so that a folder holds one set, and is written again
    whenever a trajectory is done. A set whose making was killed goes on where it was.

    Args:
        folder: made if need be.
        kind: "simulated" or "physical".
        settings: all that decides the frames.
        names: of the trajectories that belong to it, in order.

    Raises:
        FramesError: if the folder holds another set, or a manifest that cannot be read.
    """

    def __init__(self, folder: Path, kind: str, settings: dict[str, Any], names: list[str]) -> None:
        self.folder, self.names = folder, names
        if (folder / RECIPE).exists():
            raise FramesError(f"{folder} holds samples of predictor.drives: choose another folder")
        folder.mkdir(parents=True, exist_ok=True)
        self._facts = {"format": FORMAT, "kind": kind, "version": version("foresee"),
                       "settings": json.loads(json.dumps(settings)),
                       "planned": len(names)}  # fmt: skip
        self.done: dict[str, dict[str, Any]] = {}
        if (folder / MANIFEST).exists():
            theirs = read_manifest(folder)
            other = [k for k in ("kind", "settings") if theirs.get(k) != self._facts[k]]
            if other and theirs["trajectories"]:
                raise FramesError(f"{folder} holds a set with another {' and '.join(other)}: "
                                  "choose another folder")  # fmt: skip
            kept = {Path(facts["file"]).stem: facts for facts in theirs["trajectories"]}
            self.done = {name: kept[name] for name in names if self._is_whole(kept.get(name))}
        for leftover in folder.glob("*.npz.*.tmp"):
            leftover.unlink()
        self._write()

    @property
    def missing(self) -> list[str]:
        """Names of the trajectories still to be made."""
        return [name for name in self.names if name not in self.done]

    def add(self, name: str, facts: dict[str, Any]) -> None:
        """Enter a trajectory whose file is written; after this a kill cannot lose it."""
        self.done[name] = facts
        self._write()

    def _is_whole(self, facts: dict[str, Any] | None) -> bool:
        if facts is None:
            return False
        path = self.folder / facts["file"]
        return path.is_file() and checksum(path) == facts["sha256"]

    def _write(self) -> None:
        entries = [self.done[name] for name in self.names if name in self.done]
        text = json.dumps(self._facts | {"trajectories": entries}, indent=1)
        write_whole(self.folder / MANIFEST, text.encode())


def write_trajectory(
    folder: Path, name: str, arrays: dict[str, NDArray], about: dict[str, Any]
) -> dict[str, Any]:
    """Write a trajectory's file, and return what the manifest is to say of it.

    Args:
        folder: of the set.
        name: of the file, without its ending.
        arrays: as `predictor.data.frames` says.
        about: split, map, world and whatever else is worth knowing.
    """
    from benchmarks.store import commit

    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    path = folder / f"{name}.npz"
    write_whole(path, buffer.getvalue())
    return {"file": path.name} | about | {"count": len(arrays["states"]), "commit": commit(),
                                          "sha256": checksum(path)}  # fmt: skip
