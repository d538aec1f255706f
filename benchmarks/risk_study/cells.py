"""The cells of the study: what is driven, and how often."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.runs.certified import SAME
from benchmarks.runs.settings import Settings
from planner.risk.calibration import Calibration
from predictor.mapping.family_names import FAMILIES

SEED = 6_000_000
"""Of the first building of each cell: none that a network, or a calibration, has learned from."""
GAP_SEED = 6_500_000
"""Of those in which arms are compared with each other."""
SHAM = "benchmarks.risk_study.sham:Sham"
SPEEDS = (2.0, 4.0, 6.0, 8.0)
"""Top speeds at which `optimistic` and `predicted` are compared [m/s]."""


@dataclass(frozen=True)
class Cell:
    """Drives of one arm with one set of settings.

    Attributes:
        group: the question that it belongs to.
        label: what sets it apart in its group.
        settings: of the drives; `episodes` is their number.
        risk: δ that was requested, if one was.
    """

    group: str
    label: str
    settings: Settings
    risk: float | None = None

    @property
    def arm(self) -> str:
        """The arm that drives."""
        return self.settings.arms[0]

    @property
    def name(self) -> str:
        """Name of its file."""
        words = f"{self.group}-{self.label}-{self.arm}"
        return "".join(c if c.isalnum() or c in ".-+" else "_" for c in words)


def cells_of(calibration: Calibration, maps: Sequence[str], quick: bool) -> list[Cell]:
    """Return the cells of the study, those first whose answers matter most.

    Args:
        calibration: gives the level for each risk, and the mixture that it was made for.
        maps: map files or folders of real buildings; there may be none.
        quick: a few drives of each.
    """
    found = [
        *_gap(calibration),
        *_promises(calibration, maps),
        *_controls(calibration),
        *_mazes(calibration),
        *_speeds(calibration),
    ]
    if quick:
        found = [replace(c, settings=replace(c.settings, episodes=4)) for c in found]
    return found


def _settings(calibration: Calibration, **changes: object) -> Settings:
    """Return the settings that the calibration is for, with some changes."""
    same = {name: calibration.conditions[name] for name in SAME if name != "fixed_level"}
    world = tuple(calibration.conditions["world"])
    base = {"world": world, "seed": SEED, "arms": ("predicted",)}
    return Settings(**(base | same | changes))  # type: ignore[arg-type]


def _gap(calibration: Calibration) -> Iterator[Cell]:
    """Speed on a prescribed route: `known`, `oracle`, and `predicted` at each level."""
    same = {"route": "fixed", "seed": GAP_SEED, "episodes": 100}
    for arm in ("known", "oracle"):
        yield Cell("gap", arm, _settings(calibration, arms=(arm,), **same))
    for risk, level in sorted({0.0: 0.0, **calibration.levels}.items()):
        yield Cell("gap", f"risk-{risk:g}", _settings(calibration, level=level, **same), risk)


def _promises(calibration: Calibration, maps: Sequence[str]) -> Iterator[Cell]:
    """Requested against realised risk: the mixture, each family, and real maps."""
    levels = sorted({0.0: 0.0, **calibration.levels}.items())
    for risk, level in levels:
        settings = _settings(calibration, level=level, episodes=300)
        yield Cell("promise", f"mixture-{risk:g}", settings, risk)
    for family in FAMILIES:
        for risk, level in levels:
            settings = _settings(calibration, world=(family,), level=level, episodes=60)
            yield Cell("promise", f"{family}-{risk:g}", settings, risk)
    for place in maps:
        for risk, level in levels:
            settings = _settings(calibration, world=(place,), level=level, episodes=60)
            yield Cell("promise", f"{Path(place).name}-{risk:g}", settings, risk)


def _controls(calibration: Calibration) -> Iterator[Cell]:
    """What must be worse: no calibration, no adaptation, and a sham."""
    worlds = {"mixture": tuple(calibration.conditions["world"]), "trap": ("trap",)}
    for risk, level in sorted(calibration.levels.items()):
        for name, world in worlds.items():
            same = {"world": world, "episodes": 60}
            uncalibrated = _settings(calibration, level=risk, **same)
            yield Cell("uncalibrated", f"{name}-{risk:g}", uncalibrated, risk)
            fixed = _settings(calibration, level=level, fixed_level=True, **same)
            yield Cell("not adapted", f"{name}-{risk:g}", fixed, risk)
        sham = _settings(calibration, level=level, predictor=SHAM, episodes=60)
        yield Cell("sham", f"mixture-{risk:g}", sham, risk)


def _mazes(calibration: Calibration) -> Iterator[Cell]:
    """Mazes with the car, the LIDAR and the route of Elhafsi et al. 2020."""
    for v_max in (1.0, 2.0, 3.0, 4.0):
        same = {"world": ("maze",), "v_max": v_max, "braking": 3.0, "window": 7.5}
        same |= {"route": "fixed", "seed": GAP_SEED, "episodes": 30}
        for arm in ("full", "known"):
            yield Cell("maze", f"{v_max:g}-{arm}", _settings(calibration, arms=(arm,), **same))
        for risk, level in sorted({0.0: 0.0, **calibration.levels}.items()):
            settings = _settings(calibration, level=level, **same)
            yield Cell("maze", f"{v_max:g}-risk-{risk:g}", settings, risk)


def _speeds(calibration: Calibration) -> Iterator[Cell]:
    """Top speeds at which `optimistic` collides."""
    bold = max(calibration.levels, default=0.0)
    for v_max in SPEEDS:
        same = {"v_max": v_max, "route": "fixed", "seed": GAP_SEED, "episodes": 40}
        for arm in ("known", "optimistic"):
            settings = _settings(calibration, arms=(arm,), **same)
            yield Cell("speed", f"{v_max:g}-{arm}", settings)
        for risk in dict.fromkeys((0.0, bold)):
            level = calibration.levels.get(risk, 0.0)
            settings = _settings(calibration, level=level, **same)
            yield Cell("speed", f"{v_max:g}-risk-{risk:g}", settings, risk)
