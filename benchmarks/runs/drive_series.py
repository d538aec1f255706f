"""Series of drives of a study: all of them grow in turn until the time is over."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from benchmarks.runs import statistics
from benchmarks.runs.drive import run_fingerprint
from benchmarks.runs.drive_file import NO_TASK, DriveFile, refuse_other_revision
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.settings import OLDER, Settings
from benchmarks.runs.statistics import ResultsByArm
from planner.revision import FIRST
from sim.buildings import map_hashes


class DriveSeries(Protocol):
    """A series of drives of one arm with the same settings."""

    @property
    def name(self) -> str:
        """Name of its file."""

    @property
    def settings(self) -> Settings:
        """Settings of the drives; `episodes` is their number, `arms` holds one arm."""

    @property
    def turns(self) -> int:
        """Number of turns in which it is driven; with fewer turns it is complete sooner."""


def file_name(words: str) -> str:
    """Return the words that describe a series as the name of its file, without its ending."""
    return "".join(c if c.isalnum() or c in ".-+" else "_" for c in words)


def predictor_label(predictor: str) -> str:
    """Return the name of a predictor in the results: a file of weights without its folder."""
    return Path(predictor).name.removesuffix(".safetensors")


def paired_drives(drives: Mapping[str, Sequence[dict[str, Any]]]) -> ResultsByArm:
    """Return the results of arms, or other drivers, on the episodes that all of them have driven.

    Args:
        drives: name of each → entries of its drives; those in buildings without a task are left
            out.
    """
    return statistics.paired(
        {
            name: [DriveResult.from_json(d) for d in of if d["outcome"] != NO_TASK]
            for name, of in drives.items()
        }
    )


def drive_all(
    all_series: Sequence[DriveSeries],
    out: Path,
    kind: str,
    driven: Callable[[Settings, str | None, dict[str, str], int], dict[str, Any]],
    hours: float,
    jobs: int,
) -> tuple[dict[str, list[dict[str, Any]]], int]:
    """Drive until each series has its number of drives, or the time is over.

    Args:
        all_series: series, the most important first.
        out: folder of the files of drives; drives that they contain are not repeated.
        kind: kind, in the sense of `results_file`, of these files.
        driven: function that drives: from the settings of a series, the fingerprint of its weights,
            the hashes of its maps and the number of the drive to the drive's entry in the file.
        hours: time after which no further drives are started [h].
        jobs: number of worker processes.

    Returns:
        Name of each series → its drives, including those in buildings without a task; and the
        number of drives that are still missing. Series with the same settings share their drives.

    Raises:
        UsageError: if the folder holds drives with other settings, maps, weights or another
            revision of the planner, or cannot be written.
    """
    leads: dict[Settings, DriveSeries] = {}
    for series in all_series:
        leads.setdefault(series.settings, series)
    maps = {world: map_hashes(world) for world in {settings.world for settings in leads}}
    shared = {s: _file(series, out, kind, maps[s.world]) for s, series in leads.items()}
    files = {series.name: shared[series.settings] for series in all_series}
    end = time.monotonic() + 3600.0 * hours
    for turn in range(1, max(series.turns for series in all_series) + 1):
        for series in all_series:
            due = math.ceil(series.settings.episodes * min(1.0, turn / series.turns))
            if time.monotonic() > end or len(files[series.name].first(due)) == due:
                continue
            print(f"{series.name}, {due} of {series.settings.episodes}")
            settings = series.settings
            work = partial(driven, settings, run_fingerprint(settings), maps[settings.world])
            files[series.name].fill(
                work,
                range(due),
                jobs,
                lambda drive: str(drive["outcome"]),
                lambda: time.monotonic() > end,
            )
    drives = {
        series.name: files[series.name].unbroken(series.settings.episodes) for series in all_series
    }
    missing = sum(
        settings.episodes - len(drives[series.name]) for settings, series in leads.items()
    )
    return drives, missing


def _file(series: DriveSeries, out: Path, kind: str, maps: dict[str, str]) -> DriveFile:
    settings, path = series.settings, out / f"{series.name}.json"
    conditions = asdict(settings) | {"weights": run_fingerprint(settings), "maps": maps}
    file = DriveFile(path, kind, conditions, "episodes", OLDER | {"maps": maps})
    driven = [drive for drive in file.drives.values() if drive["outcome"] != NO_TASK]
    revisions = [drive.get("revision", FIRST) for drive in driven]
    refuse_other_revision(f"--out: {path}", revisions, settings.route)
    return file
