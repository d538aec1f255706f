"""The settings of a calibration, apart from those of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.runs.settings import CONDITIONS
from foresee.infra.command_line import UsageError
from foresee.infra.options import Options, option

SEED = 5_000_000
"""Seed of the first building; no training uses buildings of such seeds.

Of the published results, `docs/results/calibration-fixed-first.json` begins with it.
"""

GIVEN = ("tasks", "start", "goal")
"""Settings that give tasks; those of a calibration are drawn."""
OF_DRIVES = ("world", "predictor", "car", *(name for name in CONDITIONS if name not in GIVEN))
"""Settings of a comparison that are also options of `benchmarks.calibrate`."""


@dataclass(frozen=True)
class CalibrateSettings(Options):
    """Settings that decide a calibration, apart from those of its drives."""

    risks: tuple[float, ...] = option(
        (0.05, 0.02),
        "risks to certify, each on its own: bounds of the probability of a collision in a drive",
        "RISK",
        low=1e-4,
        high=0.5,
    )
    levels: tuple[float, ...] = option(
        (0.001, 0.003, 0.01, 0.03, 0.05, 0.1),
        "levels of the last resort to test, from safe to bold; for each risk the test ends at the "
        "first level that is not certified",
        "LEVEL",
        low=1e-6,
        high=0.9,
    )
    drives: int = option(
        1000, "most drives at a level, each in a building of its own", "N", low=1, high=10**6
    )
    confidence: float = option(
        0.9, "probability with which each certificate holds", "P", low=0.5, high=0.999
    )
    seed: int = option(SEED, "seed of the first building", "N", low=0, high=2**31)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("risks", "levels"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise UsageError(f"--{name} names a number more than once")


def refuse_without_risk(
    risks: Sequence[float], calibration: Path | None, uncertified: bool
) -> None:
    """Refuse what is only for drives at a risk, if there are none.

    Raises:
        UsageError: if a calibration is named or the drives are `uncertified`, and no risk is
            above 0.
    """
    if any(risk > 0 for risk in risks):
        return
    if calibration is not None:
        raise UsageError("--calibration needs a --risk above 0")
    if uncertified:
        raise UsageError("--uncertified needs a --risk above 0")
