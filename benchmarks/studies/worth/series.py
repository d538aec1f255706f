"""The series of drives of the study: what is driven, by which drivers, and how often."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.calibration.certificate import SHIPPED, at_risk, conditions_for, load_calibration
from benchmarks.runs.arms import ARMS, CALIBRATED_ARM
from benchmarks.runs.drive_series import file_name, predictor_label
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError

MIXTURE = ("corridor", "narrow", "office", "paper", "floor_plan")
"""Families of the mixture, in which one certificate holds."""
PRESCRIBED, WINDOWS, FREE = "prescribed", "windows", "free"
"""Parts of the study."""
RULES = ("distance", "extend")
"""Predictors without a network, baselines at a risk above 0."""
RISKS = (0.0, 0.02, 0.05)
"""Risks of the drivers on a prescribed route."""
FREE_ARMS = (
    *("known", "known+route", "backup", "predicted"),
    *(arm for arm in ARMS if arm.startswith("known+truth")),
    *("oracle", "full"),
)
"""Arms on a free route; those with the true map for the route alone are a diagnostic."""
SEED = 8_200_000
"""Seed of the first building of each part; no training and no calibration uses such seeds."""


@dataclass(frozen=True)
class Series:
    """The drives of one driver in one kind of buildings.

    Attributes:
        part: part of the study.
        tasks: name of the buildings.
        driver: name of the driver, such as "compact 2 %".
        settings: settings of the drives; `episodes` is their number.
        turns: number of turns in which it is driven.
    """

    part: str
    tasks: str
    driver: str
    settings: Settings
    turns: int = 4

    @property
    def group(self) -> tuple[str, str, float, float]:
        """What the series that are compared with this one share, with its tasks and car."""
        return self.part, self.tasks, self.settings.window, self.settings.v_max

    @property
    def arm(self) -> str:
        """The arm that drives."""
        return self.settings.arms[0]

    @property
    def name(self) -> str:
        """Name of its file."""
        sides = (f"{side:g}" for side in self.group[2:])
        return file_name("-".join([*self.group[:2], *sides, self.driver]))


def list_series(
    parts: Sequence[str],
    tasks: Sequence[str],
    maps: Sequence[str],
    predictors: Sequence[str],
    calibrations: Sequence[Path],
    buildings: int,
    sights: Sequence[tuple[float, float]],
) -> tuple[list[Series], list[str]]:
    """Return the series of the study, and a line for each driver that is left out.

    A driver is left out if no calibration is for it, or if it has the level of a smaller risk.

    Args:
        parts: parts of the study to drive.
        tasks: "mixture" and families in which the first part is driven.
        maps: map files or folders of real buildings; there may be none.
        predictors: predictors to compare.
        calibrations: calibrations besides those that ship, such as those of other predictors.
        buildings: number of buildings of each kind; on free routes half as many again.
        sights: window [m] and top speed [m/s] of each group of the second part.
    """
    kinds = {name: MIXTURE if name == "mixture" else (name,) for name in tasks}
    real = {"real": tuple(maps)} if maps else {}
    all_series: list[Series] = []
    left_out: list[str] = []
    among = (*SHIPPED, *calibrations)

    def add(part: str, name: str, same: Settings, risks: Sequence[float]) -> None:
        for predictor in predictors:
            label = predictor_label(predictor)
            drivers: dict[tuple[float, bool], str] = {}
            for risk in risks:
                asked = replace(same, predictor=predictor, arms=(CALIBRATED_ARM,), risk=risk)
                if risk:
                    asked = _as_calibrated(asked, calibrations)
                # One certificate does not hold in other buildings, windows or speeds.
                asked = replace(asked, uncertified=True)
                driver = f"{label} {100 * risk:g} %" if risk else label
                try:
                    found = at_risk(asked, among=among)
                except UsageError as error:
                    left_out.append(f"{part}, {name}: {driver} does not drive: {error}")
                    continue
                same_as = drivers.setdefault((found.level, found.uncertified), driver)
                if same_as != driver:
                    left_out.append(f"{part}, {name}: {driver} has the level of {same_as}")
                    continue
                all_series.append(Series(part, name, driver, found))

    if PRESCRIBED in parts:
        for name, world in (kinds | real).items():
            same = Settings(world=world, route="fixed", seed=SEED, episodes=buildings)
            all_series += _arms(PRESCRIBED, name, same, ("known", "backup", "perfect", "oracle"))
            add(PRESCRIBED, name, same, RISKS)
    if WINDOWS in parts:
        for window, v_max in sights:
            same = Settings(
                world=MIXTURE,
                route="fixed",
                seed=SEED + 100_000,
                episodes=buildings,
                window=window,
                v_max=v_max,
            )
            all_series += _arms(WINDOWS, "mixture", same, ("known", "backup", "perfect", "oracle"))
            add(WINDOWS, "mixture", same, RISKS[:2])
    if FREE in parts:
        for name, world in ({"mixture": MIXTURE} | real).items():
            for window in (5.0, 20.0):
                same = Settings(
                    world=world,
                    vehicle="reeds-shepp",
                    seed=SEED + 200_000,
                    episodes=buildings + buildings // 2,
                    window=window,
                )
                all_series += _arms(FREE, name, same, FREE_ARMS)
    return all_series, left_out


def _as_calibrated(asked: Settings, calibrations: Sequence[Path]) -> Settings:
    """Return settings with the reliance of a calibration of their predictor and route.

    A rule without a network may drive best at a reliance other than the default. A calibration in
    the same buildings comes before others.
    """
    conditions = conditions_for(asked)
    fitting = [
        found.conditions
        for found in map(load_calibration, calibrations)
        if all(found.conditions[name] == conditions[name] for name in ("predictor", "route"))
    ]
    fitting.sort(key=lambda found: set(found["world"]) != set(conditions["world"]))
    return replace(asked, reliance=fitting[0]["reliance"]) if fitting else asked


def _arms(part: str, name: str, same: Settings, arms: Sequence[str]) -> Iterator[Series]:
    """Yield the series of arms at a risk of 0; one without a predictor is driven without any."""
    for arm in arms:
        predictor = same.predictor if ARMS[arm].has_predictor else "none"
        yield Series(part, name, arm, replace(same, arms=(arm,), predictor=predictor))
