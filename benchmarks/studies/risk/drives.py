"""The drives of the study: all series grow in turn, until all are complete or the time is over."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runs.drive import attempt, weights_of
from benchmarks.runs.drive_file import NO_TASK, DriveFile
from benchmarks.runs.saved_run import frame_of
from benchmarks.runs.settings import OLDER, Settings
from benchmarks.studies.risk.contact_test import touches
from benchmarks.studies.risk.series import Series
from foresee.mapping.body import Body
from foresee.mapping.grid import FREE

Drives = Mapping[str, Sequence[dict[str, Any]]]
"""Name of each series → its drives."""
KIND = "risk drives"
"""Kind, in the sense of `results_file`, of the files with the drives of a series."""


def drive_all(
    all_series: Sequence[Series], out: Path, hours: float, jobs: int
) -> tuple[dict[str, list[dict[str, Any]]], int]:
    """Drive until each series has its number of drives, or the time is over.

    Args:
        all_series: series, the most important first.
        out: folder of the files of drives; drives that they contain are not repeated.
        hours: time after which no further drives are started [h].
        jobs: number of worker processes.

    Returns:
        Name of each series → its drives, including those in buildings without a task; and the
        number of drives that are still missing. Series with the same settings share their drives.

    Raises:
        UsageError: if the folder holds drives with other settings, or cannot be written.
    """
    leads: dict[Settings, Series] = {}
    for series in all_series:
        leads.setdefault(series.settings, series)
    shared = {settings: _file(series, out) for settings, series in leads.items()}
    files = {series.name: shared[series.settings] for series in all_series}
    end = time.monotonic() + 3600.0 * hours
    for turn in range(1, max(series.turns for series in all_series) + 1):
        for series in all_series:
            due = math.ceil(series.settings.episodes * min(1.0, turn / series.turns))
            if time.monotonic() > end or len(files[series.name].first(due)) == due:
                continue
            print(f"{series.name}, {due} of {series.settings.episodes}")
            work = partial(_driven, series.settings, weights_of(series.settings))
            files[series.name].fill(
                work,
                range(due),
                jobs,
                lambda drive: str(drive["outcome"]),
                lambda: time.monotonic() > end,
            )
    found = {
        series.name: files[series.name].unbroken(series.settings.episodes) for series in all_series
    }
    missing = sum(settings.episodes - len(found[series.name]) for settings, series in leads.items())
    return found, missing


def _file(series: Series, out: Path) -> DriveFile:
    told = json.loads(json.dumps(asdict(series.settings)))
    told |= {"weights": weights_of(series.settings)}
    return DriveFile(out / f"{series.name}.json", KIND, told, "episodes", OLDER)


def _driven(settings: Settings, weights: str | None, index: int) -> dict[str, Any]:
    """Drive once; return the result, and whether the car touched something, `touched`."""
    (arm,) = settings.arms
    driven = attempt(settings, weights, (index, arm))
    if isinstance(driven, str):
        return {"index": index, "outcome": NO_TASK, "note": driven}
    result, arrays = driven
    cells = arrays[f"w{index}/cells"]
    frame = frame_of(Path("trace"), arrays[f"w{index}/frame"], cells)
    states = np.asarray(arrays[f"e{index}/{arm}/states"], dtype=np.float64)
    return asdict(result) | {"touched": touches(states, cells != FREE, frame, Body())}
