"""The settings of a set of training samples, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

FAMILIES = ("corridor", "narrow", "office", "paper")
"""Learned from by default, in turn. `trap` is not, so that there is a kind of building that the
network never saw."""
MOST = 1_000_000
"""More drives than this are a slip of the pen."""


@dataclass(frozen=True)
class DrivesConfig:
    """What a set of samples is made of.

    Attributes:
        out: folder; its splits are folders inside.
        train: drives to learn from, each in a building of its own.
        validation: drives to tune on.
        longest: a drive is broken off after this [s]: many buildings teach more than long drives.
        views: times that each drive is seen again.
        every: ticks between two samples.
        logs: samples of simulated robots' logs, whose truth is the map of all their scans.
        families: of the buildings, in turn.
    """

    out: Path = Path("data/drives")
    train: int = 2000
    validation: int = 160
    longest: float = 16.0
    views: int = 2
    every: int = 6
    logs: bool = False
    families: tuple[str, ...] = FAMILIES
