"""The data sets of the prediction study: the paper's simulated one, and those of real logs."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from foresee.infra.progress import progress
from foresee.infra.workers import finished
from predictor.data.bag_config import BagConfig
from predictor.data.frame_set import FrameSet
from predictor.data.log_files import log_sources, site_name
from predictor.data.splits import check_apart
from predictor.data.survey import log_settings, make_log
from predictor.recording.paper_drives import make_drive, plan_drives, set_settings
from predictor.recording.settings import SimulatedConfig


def make_simulated(folder: Path, config: SimulatedConfig, jobs: int) -> None:
    """Make all missing drives of the simulated set, with a progress bar.

    Args:
        folder: folder of the set.
        config: settings of the set.
        jobs: number of processes.

    Raises:
        FramesError: if the folder holds another set.
        DriveError: if a drive cannot be made.
        SplitError: if a validation drive or a further test drive shares a building with others.
    """
    drives = {drive.name: drive for drive in plan_drives(config)}
    frames = FrameSet(folder, "simulated", set_settings(config), list(drives))
    # The longest drives first, so that all processes end at about the same time.
    todo = sorted((drives[name] for name in frames.missing), key=lambda drive: -drive.count)
    total = sum(drive.count for drive in drives.values())
    there = total - sum(drive.count for drive in todo)
    with progress(total=total, initial=there, unit="frame") as bar:
        bar.set_postfix_str(f"{len(frames.done)} of {len(drives)} drives", refresh=False)
        for drive, facts in finished(partial(make_drive, folder, config), todo, jobs):
            frames.add(drive.name, facts)
            bar.set_postfix_str(f"{len(frames.done)} of {len(drives)} drives", refresh=False)
            bar.update(drive.count)
    check_apart(worlds_by_split(frames.done.values()))


def worlds_by_split(trajectories: Iterable[dict[str, Any]]) -> dict[str, set[str]]:
    """Return split → hashes of the buildings of its trajectories; "test" belongs to "train".

    In the paper, training and test drives are in the same two buildings.
    """
    worlds: dict[str, set[str]] = {}
    for facts in trajectories:
        split = "train" if facts["split"] == "test" else facts["split"]
        worlds.setdefault(split, set()).add(facts["world"])
    return worlds


def make_physical(folder: Path, paths: list[Path], config: BagConfig, jobs: int) -> None:
    """Make all missing frames of a set of logs, with a progress bar, and report what was skipped.

    The set consists of exactly these logs. The frames of a log that is no longer named stay in the
    folder, but do not belong to the set.

    Args:
        folder: folder of the set.
        paths: paths of the logs.
        config: topics to read from a bag.
        jobs: number of processes.

    Raises:
        FramesError: if the folder holds another set.
        LogError: if a log cannot be read.
    """
    sites = {site_name(path): path for path in paths}
    frames = FrameSet(folder, "physical", log_settings(config), list(sites), log_sources(paths))
    todo = [sites[name] for name in frames.missing]
    with progress(total=len(sites), initial=len(sites) - len(todo), unit="log") as bar:
        for path, facts in finished(partial(make_log, folder, config), todo, jobs):
            frames.add(site_name(path), facts)
            passed = "".join(f"; skipped: {n} {what}" for what, n in facts["skipped"].items() if n)
            bar.write(f"{facts['map']}: {facts['count']} frames{passed}", file=sys.stderr)
            for note in facts["notes"]:
                bar.write(f"{facts['map']}: {note}", file=sys.stderr)
            bar.update()
