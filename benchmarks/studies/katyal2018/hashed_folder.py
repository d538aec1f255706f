"""The folder of finished parts, whose file names are hashes of all that decides their contents.

The same command therefore computes nothing twice, and predictors, expansions and sites can be added
to a folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

from benchmarks.studies.katyal2018.contestants import BASELINES, Contestant
from benchmarks.studies.katyal2018.stretch_scores import Stretch
from foresee.infra.atomic_file import write_whole
from foresee.infra.plain_json import loads
from foresee.infra.resumable import ResumableFolder

VERSION = 3
"""Version of the measures, which changes with the definition of any of them."""


class HashedFolder(ResumableFolder):
    """A folder of parts whose names are hashes of what decides them."""

    def name(self, kind: str, *decided_by: Any) -> str:
        """Return the name of a part.

        Args:
            kind: beginning of the name.
            decided_by: plain data that decide the content of the part.
        """
        text = json.dumps([VERSION, kind, *decided_by])
        return f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"

    def scores_name(self, stretch: Stretch, sha256: str, contestant: Contestant) -> str:
        """Return the name of a contestant's scores on a stretch.

        Args:
            stretch: the stretch; its other contestants do not matter.
            sha256: checksum of the drive's file.
            contestant: the contestant.
        """
        own = stretch.rates if contestant.name in BASELINES else contestant.expansion
        return self.name(
            "scores", sha256, stretch.frames, stretch.expansion, contestant.identity, own
        )

    def once(self, measure: Callable[[], Any], kind: str, *decided_by: Any) -> Any:
        """Return a stored measurement, or measure and store it.

        Args:
            measure: function that measures.
            kind: see `name`.
            decided_by: see `name`.
        """
        path = (self.folder / self.name(kind, *decided_by)).with_suffix(".json")
        try:
            return loads(path.read_text())
        except (OSError, ValueError):
            measured = measure()
            write_whole(path, json.dumps(measured).encode())
            return measured
