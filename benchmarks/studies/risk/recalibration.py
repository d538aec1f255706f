"""Repeated calibrations: each on one block of drives of the study, tested on all other blocks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import Any

from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.statistics import wilson
from benchmarks.studies.risk.drives import Drives
from benchmarks.studies.risk.series import MIXTURE, PROMISE, Series
from planner.risk.betting import capital, decided_after, needed

BLOCK = 75
"""Number of buildings in a block. Without a collision, 70 drives certify a risk of 0.05."""
RISKS = (0.05, 0.1, 0.2)
"""Risks δ for which each block is calibrated."""


def recalibrations(
    all_series: Sequence[Series], drives: Drives, predictor: str, confidence: float
) -> list[dict[str, Any]]:
    """Calibrate on each block as `benchmarks.calibrate` does, and count collisions in all others.

    The levels are tested from safe to bold, up to the boldest one at which all blocks have drives.
    Collisions are counted in the drives of the other blocks at the certified level. The families
    take turns in a block, whereas `benchmarks.calibrate` draws them at random.

    Args:
        all_series: series of the study.
        drives: name of each series → its drives.
        predictor: name of the predictor that is calibrated.
        confidence: probability with which each certificate holds.

    Returns:
        A row for each block and risk. If the first level was not certified, the level is 0, and
        nothing is counted.
    """
    by_level = dict(
        sorted(
            (series.settings.level, [_collided(drive) for drive in drives[series.name]])
            for series in all_series
            if _is_calibrated(series, predictor)
        )
    )
    blocks = max(map(len, by_level.values()), default=0) // BLOCK
    complete = takewhile(lambda level: len(by_level[level]) >= blocks * BLOCK, by_level)
    by_level = {level: by_level[level] for level in complete}
    rows = []
    for block in range(blocks):
        for risk in RISKS:
            level = _certified(by_level, block, risk, confidence)
            others = _outside(by_level.get(level, []), block)
            rows.append(
                {
                    "block": block,
                    "requested": risk,
                    "level": level,
                    "drives": len(others),
                    "collided": sum(others),
                    "rate": sum(others) / len(others) if others else None,
                    "interval": list(wilson(int(sum(others)), len(others))) if others else None,
                }
            )
    return rows


def _is_calibrated(series: Series, predictor: str) -> bool:
    """Return whether a series's drives are in the calibrated mixture, at a level above 0."""
    return (
        (series.group, series.tasks, series.arm) == (PROMISE, MIXTURE, "predicted")
        and series.settings.predictor == predictor
        and series.settings.level > 0.0
    )


def _certified(
    by_level: dict[float, list[float | None]], block: int, risk: float, confidence: float
) -> float:
    """Return the largest level that a block certifies for a risk; 0 if it certifies none."""
    certified = 0.0
    for level, collided in by_level.items():
        in_block = collided[block * BLOCK : (block + 1) * BLOCK]
        losses = [loss for loss in in_block if loss is not None]
        # As in a calibration: a test that was given up is not revived by later drives.
        end = decided_after(losses, risk, len(losses), needed(confidence))
        if not (capital(losses[:end], risk) >= needed(confidence)).any():
            break
        certified = level
    return certified


def _outside(collided: list[float | None], block: int) -> list[float]:
    outside = collided[: block * BLOCK] + collided[(block + 1) * BLOCK :]
    return [loss for loss in outside if loss is not None]


def _collided(drive: dict[str, Any]) -> float | None:
    """Return 1 for a collision, 0 for none; None for a building without a task."""
    return None if drive["outcome"] == NO_TASK else float(drive["outcome"] == "collided")
