"""The drives of the study: new ones, which are tested for contacts, and saved ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.runs.arms import ARMS
from benchmarks.runs.car import limits_for
from benchmarks.runs.drive import attempt
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import Settings
from benchmarks.runs.trace import Drive
from benchmarks.studies.contact_test import touches
from benchmarks.studies.risk.series import Series
from foresee.infra.command_line import UsageError
from foresee.infra.progress import progress
from foresee.mapping.body import Body
from foresee.mapping.grid import FREE

Drives = Mapping[str, Sequence[dict[str, Any]]]
"""Name of each series → its drives."""
KIND = "risk drives"
"""Kind, in the sense of `results_file`, of the files with the drives of a series."""


def driven(
    settings: Settings, weights: str | None, maps: Mapping[str, str], index: int
) -> dict[str, Any]:
    """Drive once; return the result, and whether the car touched something, `touched`."""
    (arm,) = settings.arms
    driven = attempt(settings, weights, (index, arm), maps)
    if isinstance(driven, str):
        return {"index": index, "outcome": NO_TASK, "note": driven}
    return _tested(driven, limits_for(settings).body)


def _tested(drive: Drive, body: Body) -> dict[str, Any]:
    """Return the result of a drive, and whether the car's body touched something, `touched`."""
    truth = drive.trace.truth
    touched = touches(drive.trace.states, truth.cells != FREE, truth.frame, body)
    return asdict(drive.result) | {"touched": touched}


def saved_drives(folders: Sequence[Path]) -> tuple[list[Series], dict[str, list[dict[str, Any]]]]:
    """Return a series for each arm of each saved run; and name of the series → its drives.

    Args:
        folders: folders of runs of `benchmarks.corridor` at a risk of 0.

    Raises:
        RunError: if a folder holds no run, or a damaged one.
        UsageError: if a run was not at a risk of 0 or has an unknown arm, or two folders have the
            same name.
    """
    all_series: list[Series] = []
    drives: dict[str, list[dict[str, Any]]] = {}
    for folder in folders:
        run = Run.load(folder)
        if run.settings["risk"] or run.settings["level"]:
            raise UsageError(f"--runs: {folder} was not driven at a risk of 0")
        for arm in run.arms:
            if arm not in ARMS:
                raise UsageError(f"--runs: {folder} has an arm {arm!r}, which no longer exists")
            series = _series(run, arm)
            if series.name in drives:
                raise UsageError(f"--runs: each folder must have a name of its own, as {folder}")
            all_series.append(series)
            results = [result for result in run.episodes if result.arm == arm]
            drives[series.name] = [
                _tested(Drive(result, run.trace(result.index, arm)), run.body)
                for result in progress(results, desc=f"{run.label}, {arm}", unit="drive")
            ]
    return all_series, drives


def _series(run: Run, arm: str) -> Series:
    settings = Settings.of_saved(run.settings, arms=(arm,))
    reliance = ARMS[arm].reliance
    reliance = run.settings["reliance"] if reliance is None else reliance
    # Arms that treat unobserved space as free promise nothing, nor do cars with a noisy LIDAR.
    risk = None if reliance == 1.0 or run.setting("noise") > 0.0 else 0.0
    return Series("run", run.label, arm, settings, risk)
