"""Sets of training samples: a file for each drive of each split, made in parallel.

Files are written atomically, so that the same call continues after an interruption.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from foresee.infra.progress import progress
from foresee.infra.workers import finished

DRIVES = {"train": 1_600_000, "validation": 540_000}
"""First seed of each split of `training_drives`. Published measurements use other seeds, below
10,000, from 700,000 to 1,000,000, and from 2,000,000 on; earlier weights used 1,000,000 to
1,400,000 and 500,000 to 530,000."""
EXPLORATIONS = {"train": 1_400_000, "validation": 530_000}
"""First seed of each split of `exploration`."""
Item = tuple[str, int]
"""Split, and number of the drive in it."""


def sample_path(folder: Path, item: Item) -> Path:
    """Return the path of the file with a drive's samples."""
    split, number = item
    return folder / split / f"{number:06d}.npz"


def make_missing(
    folder: Path,
    drives: Mapping[str, int],
    record: Callable[[Item], tuple[int, str]],
    jobs: int,
    unit: str,
) -> None:
    """Make all files of a set that are missing, with a progress bar.

    Args:
        folder: folder of the set.
        drives: split → number of its drives.
        record: function that writes the file of a drive, and returns the number of samples and why
            there is none, or an empty string. It must be picklable.
        jobs: number of worker processes.
        unit: name of a drive in the progress bar.
    """
    for split in drives:
        (folder / split).mkdir(parents=True, exist_ok=True)
    items = [(split, number) for split, count in drives.items() for number in range(count)]
    todo = [item for item in items if not sample_path(folder, item).exists()]
    total, reasons = 0, set[str]()
    with progress(total=len(items), initial=len(items) - len(todo), unit=unit) as bar:
        for _, (samples, reason) in finished(record, todo, jobs):
            total += samples
            if reason and reason not in reasons:
                reasons.add(reason)
                bar.write(reason, file=sys.stderr)
            bar.set_postfix_str(f"{total} samples", refresh=False)
            bar.update()
