"""Drives of saved runs of `benchmarks.corridor`, with the independent test for contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import ARMS, Settings
from benchmarks.studies.risk.contact_test import touches
from benchmarks.studies.risk.series import Series
from foresee.infra.command_line import UsageError
from foresee.mapping.body import Body
from foresee.mapping.grid import FREE


def saved_drives(folders: Sequence[Path]) -> tuple[list[Series], dict[str, list[dict[str, Any]]]]:
    """Return a series for each arm of each run; and name of the series → its drives.

    Args:
        folders: folders of runs at a risk of 0.

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
            drives[series.name] = _tested(run, arm)
    return all_series, drives


def _series(run: Run, arm: str) -> Series:
    told = {
        field.name: run.settings[field.name]
        for field in fields(Settings)
        if field.name in run.settings
    }
    told |= {"world": tuple(run.settings["world"]), "arms": (arm,)}
    reliance = ARMS[arm].reliance
    reliance = run.settings["reliance"] if reliance is None else reliance
    # Arms that treat unobserved space as free promise nothing, nor do cars with a noisy LIDAR.
    risk = None if reliance == 1.0 or run.setting("noise") > 0.0 else 0.0
    return Series("run", run.label, arm, Settings(**told), risk)


def _tested(run: Run, arm: str) -> list[dict[str, Any]]:
    found = []
    mine = [episode for episode in run.episodes if episode.arm == arm]
    for episode in tqdm(mine, desc=f"{run.label}, {arm}", unit="drive"):
        truth, trace = run.truth(episode.index), run.trace(episode.index, arm)
        touched = touches(trace.states, truth.cells != FREE, truth.frame, Body())
        found.append(asdict(episode) | {"touched": touched})
    return found
