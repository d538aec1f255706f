"""The settings of a set of training samples, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from predictor.infra.options import Options, option
from predictor.mapping.families import FAMILIES

LEARNED = ("corridor", "narrow", "office", "paper")
"""Families to learn from by default. `trap` is held out, so that the network never sees one kind of
building."""


@dataclass(frozen=True)
class DrivesConfig(Options):
    """What a set of samples is made of; its options say what they are.

    Attributes:
        longest: a drive is broken off after this [s]: many buildings teach more than long drives.
        views: times that each drive is seen again.
        every: ticks between two samples.
    """

    out: Path = option(Path("data/drives"), "folder of the samples", "DIR", parse=Path)
    train: int = option(
        2000, "drives to learn from; one gives about 50 samples", "N", low=1, high=1_000_000
    )
    validation: int = option(160, "drives to tune on", "N", low=1, high=1_000_000)
    longest: float = 16.0
    views: int = 2
    every: int = 6
    logs: bool = option(
        False,
        "of simulated robots' logs instead, as real ones are made: 180°, scans up to a metre "
        "apart, people, and as truth the map of all the log's scans",
    )
    families: tuple[str, ...] = option(LEARNED, "of the buildings, in turn", "F", choices=FAMILIES)
