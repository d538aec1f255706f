"""The series of drives of the study: what is driven, and how often."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.calibration.certificate import conditions_for
from benchmarks.runs.drive_series import file_name
from benchmarks.runs.settings import CONDITIONS, Settings
from foresee.infra.command_line import UsageError
from foresee.infra.errors import one_line
from foresee.mapping.family_names import FAMILIES
from planner.risk.calibration import Calibration, CalibrationError
from predictor.recording.settings import LEARNED

PROMISE, MIXTURE = "promise", "mixture"
"""Group of the drives at requested risks, and tasks in the buildings of the calibration."""
OWN = "own calibration"
"""Group of the drives that test further calibrations, in buildings like those of each."""
PUBLISHED = "published settings"
"""Group of the drives with the buildings and the car of a published method."""
SEED = 6_000_000
"""Seed of the first building of each series; no network or calibration used such seeds."""
OTHER_SEED = 6_500_000
"""Seed of the first building of the mazes, which have another car than the calibration."""
OWN_SEED = 6_800_000
"""Seed of the first building of the drives that test a further calibration."""
SHAM = "benchmarks.studies.risk.sham:Sham"
HELD_OUT = tuple(family for family in FAMILIES if family not in LEARNED)
"""Families that no network, and no calibration, has learned from."""


@dataclass(frozen=True)
class Series:
    """A series of drives of one arm with the same settings.

    Attributes:
        group: name of the question that it answers.
        tasks: name of its tasks; the series of a group with the same tasks are compared.
        variant: what distinguishes it from these, such as its arm or risk.
        settings: settings of the drives; `episodes` is their number.
        risk: requested risk δ; 0 where the level is 0; None if no risk was requested.
        turns: number of turns in which it is driven; with fewer turns it is complete sooner.
    """

    group: str
    tasks: str
    variant: str
    settings: Settings
    risk: float | None = None
    turns: int = 5

    @property
    def arm(self) -> str:
        """The arm that drives."""
        return self.settings.arms[0]

    @property
    def label(self) -> str:
        """Name in its group."""
        return f"{self.tasks}-{self.variant}"

    @property
    def name(self) -> str:
        """Name of its file."""
        return file_name(f"{self.group}-{self.label}-{self.arm}")


def list_series(
    calibration: Calibration,
    others: Sequence[Calibration],
    predictor: str,
    maps: Sequence[str],
    quick: bool,
) -> list[Series]:
    """Return the series of the study, those first whose answers matter most.

    Args:
        calibration: calibration that gives the level λ of each risk; its buildings are the mixture.
        others: further calibrations, such as one for each family of the mixture. They are only
            tested in their own buildings.
        predictor: name of the predictor that the calibrations were made for.
        maps: map files or folders of real buildings; there may be none.
        quick: whether each series has 4 drives only, as a trial.

    Raises:
        CalibrationError: if the calibration is for another predictor, planner or car, or was made
            in buildings of the study.
        UsageError: if two of the maps have the same name.
    """
    mixture = _settings(calibration, predictor)
    all_series = [
        *_promises(calibration, mixture, maps),
        *(series for other in others for series in _in_its_buildings(other, predictor)),
        *_controls(calibration, mixture),
        *_mazes(calibration, mixture),
    ]
    if len({series.name for series in all_series}) < len(all_series):
        raise UsageError(
            "each map or folder of --maps, and each calibration, must have a name of its own"
        )
    for used in (calibration, *others):
        if any(
            used.has_used(series.settings.seed, series.settings.episodes) for series in all_series
        ):
            raise CalibrationError(
                f"{used.path} was made in buildings of this study: calibrate with another --seed"
            )
    if quick:
        all_series = [replace(c, settings=replace(c.settings, episodes=4)) for c in all_series]
    return all_series


def _settings(calibration: Calibration, predictor: str) -> Settings:
    """Return the settings that the calibration is for.

    Raises:
        CalibrationError: if it is for another predictor, planner or car.
    """
    try:
        same = {name: calibration.conditions[name] for name in CONDITIONS}
        world = tuple(map(str, calibration.conditions["world"]))
        settings = Settings(
            world=world,
            predictor=predictor,
            seed=SEED,
            arms=("predicted",),
            calibrated=calibration.revision,
            **same,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{calibration.path} is no calibration: {one_line(error)}") from None
    calibration.refuse_other(conditions_for(settings))
    return settings


def _cautious(calibration: Calibration) -> tuple[float, float]:
    """Return the smallest certified risk, and its level; both are 0 if no risk is certified."""
    return min(calibration.levels.items(), default=(0.0, 0.0))


def _smallest_risks(calibration: Calibration) -> dict[float, float]:
    """Return risk → level, with only the smallest risk of each level.

    Drives at the same level are the same, whatever the risk.
    """
    smallest = {level: risk for risk, level in sorted(calibration.levels.items(), reverse=True)}
    return {risk: level for level, risk in sorted(smallest.items())}


def _promises(calibration: Calibration, mixture: Settings, maps: Sequence[str]) -> Iterator[Series]:
    """Requested against realised risk: the mixture, held-out families, and real maps."""
    certified = _smallest_risks(calibration)
    for risk, level in {0.0: 0.0, **certified}.items():
        settings = replace(mixture, level=level, episodes=300 if risk else 60)
        yield Series(PROMISE, MIXTURE, f"{risk:g}", settings, risk, turns=2)
    # What the speed and the collisions at each risk are compared with.
    same = replace(mixture, episodes=60)
    for arm in ("known", "oracle"):
        yield Series(PROMISE, MIXTURE, arm, replace(same, arms=(arm,)), 0.0, turns=2)
    optimistic = replace(same, arms=("optimistic",), episodes=100)
    yield Series(PROMISE, MIXTURE, "optimistic", optimistic, turns=2)
    for place in (*HELD_OUT, *maps):
        there = replace(mixture, world=(place,), episodes=40)
        known = replace(there, arms=("known",))
        yield Series(PROMISE, Path(place).stem, "known", known, 0.0)
        for risk, level in certified.items():
            # The larger risks need fewer drives.
            at_level = replace(there, level=level, episodes=40 if risk <= 0.05 else 20)
            yield Series(PROMISE, Path(place).stem, f"{risk:g}", at_level, risk)


def _in_its_buildings(calibration: Calibration, predictor: str) -> Iterator[Series]:
    """Requested against realised risk of a further calibration, in buildings like its own."""
    same = replace(_settings(calibration, predictor), seed=OWN_SEED)
    tasks = "+".join(Path(place).stem for place in same.world)
    for risk, level in _smallest_risks(calibration).items():
        settings = replace(same, level=level, episodes=60)
        yield Series(OWN, tasks, f"{risk:g}", settings, risk, turns=2)
    for arm in ("known", "oracle"):
        yield Series(OWN, tasks, arm, replace(same, arms=(arm,), episodes=30), 0.0, turns=2)


def _controls(calibration: Calibration, mixture: Settings) -> Iterator[Series]:
    """Controls that may collide more: no adaptation; a sham predictor, with and without it."""
    if not calibration.levels:
        return
    risk, level = _cautious(calibration)
    same = replace(mixture, level=level, episodes=40)
    fixed = replace(same, world=("trap",), fixed_level=True)
    yield Series("not adapted", "trap", f"{risk:g}", fixed, risk)
    sham = replace(same, predictor=SHAM, episodes=60)
    yield Series("sham", MIXTURE, f"{risk:g}", sham, risk)
    yield Series("sham, not adapted", MIXTURE, f"{risk:g}", replace(sham, fixed_level=True), risk)


def _mazes(calibration: Calibration, mixture: Settings) -> Iterator[Series]:
    """Mazes as in Elhafsi et al. 2020, at the highest of their top speeds: their braking, window
    and given route."""
    same = replace(
        mixture,
        world=("maze",),
        v_max=4.0,
        braking=3.0,
        window=7.5,
        route="fixed",
        seed=OTHER_SEED,
        episodes=30,
    )
    for arm in ("full", "known"):
        yield Series(PUBLISHED, "maze", arm, replace(same, arms=(arm,)), 0.0)
    yield Series(PUBLISHED, "maze", "0", same, 0.0)
    if level := _cautious(calibration)[1]:
        yield Series(PUBLISHED, "maze", "bold", replace(same, level=level))
