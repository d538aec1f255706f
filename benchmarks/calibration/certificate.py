"""The level of the last resort that a calibration certifies for the settings of a comparison."""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.calibration.settings import OF_DRIVES, refuse_without_risk
from benchmarks.runs.arms import ARMS, CALIBRATED_ARM, arm_at, arm_kind
from benchmarks.runs.driver import navigator_config
from benchmarks.runs.settings import CONDITIONS, NO_CONDITIONS, OLDER, Settings
from foresee.infra.command_line import UsageError
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import world_hash
from planner.risk.calibration import Calibration, CalibrationError
from predictor.registry import fingerprint_of
from sim.buildings import sources
from sim.map_server import load_world

SHIPPED = tuple(sorted(Path(__file__).with_name("shipped").glob("*.json")))
"""The calibrations that ship with the package."""
ABSENT = {name: OLDER[name] for name in CONDITIONS}
"""Condition → its value where a calibration does not contain it, because it is older."""
HASHED = {
    "": "window expansion reliance level adapt steer start_margin deadline",
    "car": "v_max acceleration braking lateral_acceleration turning_radius reverse",
    "car.body": "length width",
    "mpc": "progress contour final effort smoothness closeness comfort violation margin "
    "curvature_step iterations tolerance",
    "guide": "every delay ahead better join beside turning_room leg_end onward",
    "guide.search": "slack batch iterations refinements",
    "guide.hybrid": "slack margin reversing shift steering nodes",
    "guide.line": "reach bending push comfort tether hold iterations",
}
"""Part of the planner's settings → names of the settings that are always hashed: those of the first
calibrations. Never change them, or the published calibrations are refused."""
REMOVED = {"oracle": False, "margin": 0.0, "mpc.dt": 0.1}
"""Setting of the first calibrations that the planner no longer has → the value that it then had."""


def conditions_for(settings: Settings) -> dict[str, Any]:
    """Return the conditions, by name, that a calibration for drives of some settings must have."""
    config = navigator_config(replace(settings, level=0.0), ARMS[CALIBRATED_ARM])
    weights = fingerprint_of(settings.predictor)
    return {
        **_map_conditions(settings),
        # Without the runtime, which only changes the rounding: single cells by up to 0.1.
        "predictor": (weights or settings.predictor).partition(" on ")[0],
        "world": list(settings.world),
        **{
            field.name: getattr(settings, field.name)
            for field in fields(settings)
            if field.name not in NO_CONDITIONS
        },
        "planner": planner_hash(config),
    }


def _map_conditions(settings: Settings) -> dict[str, Any]:
    """Return the hashes of the cells of all map files, since a file may change, and resolutions."""
    paths = [place for place in sources(settings.world) if place not in FAMILIES]
    grids = [load_world(path).grid for path in paths]
    pairs = sorted((world_hash(grid.cells), grid.frame.resolution) for grid in grids)
    if not pairs:
        return {}
    return {"maps": [cells for cells, _ in pairs], "resolutions": [side for _, side in pairs]}


def absent_in(conditions: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of conditions that older calibrations do not contain.

    Args:
        conditions: conditions of the calibration, or those that are compared with it.
    """
    maps = conditions.get("maps")
    if not isinstance(maps, list):
        return ABSENT
    return ABSENT | {"resolutions": [RESOLUTION] * len(maps)}


def planner_hash(config: Any) -> str:
    """Return a hash of the planner's settings that stays the same when the planner is changed.

    Settings that are newer than the first calibrations count only if they differ from their
    defaults: at its default, a new setting must leave all drives as they were.

    Args:
        config: a `NavigatorConfig`.
    """
    present = dict(_flat(config))
    hashed = dict[str, Any](REMOVED)
    for part, names in HASHED.items():
        for name in names.split():
            full = f"{part}.{name}".lstrip(".")
            hashed[full], _ = present.pop(full)
    hashed |= {name: value for name, (value, default) in present.items() if value != default}
    nested: dict[str, Any] = {}
    for full, value in hashed.items():
        *parts, name = full.split(".")
        place = nested
        for part in parts:
            place = place.setdefault(part, {})
        place[name] = value
    return hashlib.sha256(json.dumps(nested, sort_keys=True).encode()).hexdigest()


def _flat(config: Any, prefix: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield the full name of each setting in a nested configuration, its value and its default."""
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            yield from _flat(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, (value, _default(field))


def _default(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return field.default


def load_calibration(path: Path) -> Calibration:
    """Read a calibration, with the defaults of settings that are newer than it.

    Raises:
        CalibrationError: if it cannot be read.
    """
    certificate = Calibration.load(path)
    conditions = certificate.conditions
    return replace(certificate, conditions=absent_in(conditions) | conditions)


def at_risk(
    settings: Settings, calibration: Path | None = None, among: Sequence[Path] = SHIPPED
) -> Settings:
    """Return the settings with the level that a calibration certifies for their risk.

    Args:
        settings: settings of drives; if they are `uncertified`, a calibration for other drives will
            do. In the result they are so only if it had to.
        calibration: calibration.json of `benchmarks.calibrate`; None: the one that fits.
        among: calibrations among which the one that fits is looked for.

    Raises:
        UsageError: if both risk and level are given, or no calibration is for these drives; if the
            arm that calibrations are of does not drive, or another arm takes risks.
        CalibrationError: if the calibration is for other settings, or only for larger risks, or was
            made with drives in the same buildings.
    """
    for arm in settings.arms:
        if arm not in ARMS:
            raise UsageError(f"no arm is called {arm!r}: give the risk with --risk")
    if settings.risk == 0.0:
        return replace(settings, uncertified=False)
    if settings.level > 0.0:
        raise UsageError("--level is in place of --risk: give one of them")
    if not settings.draws_tasks and not settings.uncertified:
        given = "--start" if settings.tasks is None else "--tasks"
        raise UsageError(
            f"--risk: calibrations are for drawn tasks, not for those of {given}: drive without a "
            "certificate, with --uncertified"
        )
    strange = [arm for arm in settings.arms if _strange(arm)]
    if strange:
        names = ", ".join(strange)
        raise UsageError(f"--risk: a calibration is of the arm {CALIBRATED_ARM}, not of {names}")
    if CALIBRATED_ARM not in map(arm_kind, settings.arms):
        raise UsageError(f"--risk is of the arm {CALIBRATED_ARM}, which --arms does not name")
    conditions = conditions_for(settings)
    if calibration is None:
        chosen = _fitting(settings, conditions, among)
    else:
        chosen = load_calibration(calibration)
        if not settings.uncertified:
            chosen.refuse_other(conditions)
    seen = _has_seen(chosen, settings)
    if seen and not settings.uncertified:
        raise CalibrationError(
            f"{chosen.path} was made with drives in the same buildings: choose another --seed, or "
            "drive without a certificate, with --uncertified"
        )
    return replace(
        settings,
        level=chosen.level_at(settings.risk),
        calibrated=chosen.revision,
        uncertified=seen or bool(chosen.differing(conditions)),
    )


def arms_at(
    settings: Settings, risks: Sequence[float], calibration: Path | None = None
) -> dict[str, Settings]:
    """Return the settings of the drives of each arm; `CALIBRATED_ARM` drives at each of the risks.

    The keys are the names of the arms, see `benchmarks.runs.arms.arm_at`. All settings name all
    of these arms.

    Args:
        settings: settings of the drives, without a risk.
        risks: accepted probabilities δ of a collision in a drive.
        calibration: as in `at_risk`.

    Raises:
        UsageError: as `at_risk`; if a calibration is named or the settings are `uncertified`, and
            no risk is above 0.
        CalibrationError: as `at_risk`.
    """
    refuse_without_risk(risks, calibration, settings.uncertified)
    plain = replace(settings, risk=0.0, uncertified=False)
    arms = dict.fromkeys(settings.arms, plain)
    at_risks = {arm_at(r): at_risk(replace(settings, risk=r), calibration) for r in risks}
    if CALIBRATED_ARM in arms:
        place = settings.arms.index(CALIBRATED_ARM)
        before, after = settings.arms[:place], settings.arms[place + 1 :]
        names = (*before, *at_risks, *after)
        arms = {name: at_risks.get(name, plain) for name in names}
    return {name: replace(chosen, arms=tuple(arms)) for name, chosen in arms.items()}


def _has_seen(calibration: Calibration, settings: Settings) -> bool:
    """Return whether a calibration was made with drives in the buildings of some settings."""
    buildings = math.ceil(settings.episodes / len(sources(settings.world)))
    return settings.draws_tasks and calibration.has_used(settings.seed, buildings)


def _strange(arm: str) -> bool:
    """Return whether an arm takes the chosen risk, but is not the one that calibrations are of."""
    return ARMS[arm_kind(arm)].takes_risk and arm_kind(arm) != CALIBRATED_ARM


def _fitting(
    settings: Settings, conditions: Mapping[str, Any], among: Sequence[Path]
) -> Calibration:
    """Return the calibration, out of some, for drives at a risk.

    For uncertified drives that none is for, it is that of their mixture, or else of the mixture of
    most families, for the same predictor and route.

    Raises:
        UsageError: if there is none; the message says how to make one.
    """
    certificates = [c for c in map(load_calibration, among) if c.levels]
    certificates = [c for c in certificates if min(c.levels) <= settings.risk]
    fitting = [c for c in certificates if not c.differing(conditions)]
    if not fitting and settings.uncertified:
        fitting = [
            c
            for c in certificates
            if len(c.conditions["world"]) > 1
            and all(c.conditions[name] == conditions[name] for name in ("predictor", "route"))
        ]
        same = set(settings.world)
        fitting.sort(
            key=lambda c: (
                set(c.conditions["world"]) == same,
                len(set(c.conditions["world"]) & set(FAMILIES)),
            ),
            reverse=True,
        )
    if not fitting:
        or_else, instead = "", "; or drive without a certificate, with --uncertified"
        if settings.uncertified:
            or_else, instead = ", nor of a mixture for the same predictor and route", ""
        raise UsageError(
            f"no calibration that ships with foresee is for these drives at a risk of "
            f"{settings.risk:g}{or_else}: make one with `{_command(settings)}` and name it with "
            f"--calibration{instead}"
        )
    return fitting[0]


def _command(settings: Settings) -> str:
    """Return the command that makes a calibration for drives with some settings at their risk."""
    words = ["foresee", "calibrate", "--risks", f"{settings.risk:g}"]
    usual = Settings.with_defaults(car=settings.car)
    for name in [f.name for f in fields(Settings) if f.name in OF_DRIVES and f.metadata]:
        value = getattr(settings, name)
        if value != getattr(Settings if name == "car" else usual, name):
            words.append(f"--{name.replace('_', '-')}")
            if not isinstance(value, bool):
                words += map(str, value if isinstance(value, tuple) else (value,))
    return shlex.join(words)
