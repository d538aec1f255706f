"""What is finished, on disk: each piece in a file that is named after all that decides it.

So nothing is done twice, a kill loses one stretch at most, and a folder can grow: by predictors, by
expansions, by sites.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prediction.contestants import BASELINES, Contestant
from benchmarks.prediction.scoring import Kept, Stretch
from predictor.infra.atomic_file import clear, write_whole
from predictor.infra.plain_json import loads

VERSION = 3
"""Of what is measured; another number when a measure changes its meaning."""


class Store:
    """A folder of pieces.

    Args:
        folder: made if need be.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        clear(folder)

    def scores_path(self, stretch: Stretch, sha256: str, contestant: Contestant) -> Path:
        """Where a contestant's scores on a stretch are kept.

        Args:
            stretch: which; who else is asked does not matter.
            sha256: of the drive's file.
            contestant: who.
        """
        own = stretch.rates if contestant.name in BASELINES else contestant.expansion
        return self.path("scores", sha256, stretch.frames, stretch.expansion, contestant.identity,
                         own)  # fmt: skip

    def path(self, kind: str, *decided_by: Any) -> Path:
        """Where a piece is kept that a few plain things decide."""
        text = json.dumps([VERSION, kind, *decided_by])
        return self.folder / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"


def write_arrays(path: Path, arrays: Kept, facts: dict[str, Any]) -> None:
    """Write a piece, whole or not at all."""
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)
    np.savez_compressed(buffer, allow_pickle=False, facts=text, **arrays)
    write_whole(path, buffer.getvalue())


def read_arrays(path: Path) -> tuple[Kept, dict[str, Any]] | None:
    """A piece; None if there is none, or none that can be read."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files if name != "facts"}
            return arrays, dict(loads(bytes(file["facts"])))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
