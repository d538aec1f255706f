"""A drive of the study, as an entry of the file of its series."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from benchmarks.runs.drive import attempt
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.settings import Settings

KIND = "worth drives"
"""Kind, in the sense of `results_file`, of the files with the drives of a series."""


def driven(
    settings: Settings, weights: str | None, maps: Mapping[str, str], index: int
) -> dict[str, Any]:
    """Drive once, and return the entry."""
    (arm,) = settings.arms
    result = attempt(settings, weights, (index, arm), maps)
    if isinstance(result, str):
        return {"index": index, "outcome": NO_TASK, "note": result}
    return asdict(result.result)
