"""The level of the last resort that a calibration certifies for the settings of a comparison."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.runs.drive import navigator_config
from benchmarks.runs.settings import ARMS, CONDITIONS, Settings
from foresee.infra.command_line import UsageError
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.family_names import FAMILIES
from foresee.mapping.grid import world_hash
from planner.risk.calibration import Calibration
from predictor.provenance import fingerprint_of
from predictor.registry import load_predictor
from sim.buildings import sources
from sim.map_server import load_world


def conditions_of(settings: Settings) -> dict[str, Any]:
    """Return the conditions, by name, that a calibration for drives of some settings must have."""
    config = asdict(navigator_config(replace(settings, level=0.0), ARMS["predicted"], RESOLUTION))
    weights = fingerprint_of(load_predictor(settings.predictor))
    maps = [place for place in sources(settings.world) if place not in FAMILIES]
    return {
        # Maps are identified by the hash of their cells, since a file may change.
        **(
            {"maps": sorted(world_hash(load_world(path).grid.cells) for path in maps)}
            if maps
            else {}
        ),
        # Without the runtime, which only changes the rounding.
        "predictor": (weights or settings.predictor).partition(" on ")[0],
        "world": list(settings.world),
        **{name: getattr(settings, name) for name in CONDITIONS},
        "planner": hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest(),
    }


def at_risk(settings: Settings, calibration: Path | None = None) -> Settings:
    """Return the settings with the level that a calibration certifies for their risk.

    Args:
        settings: settings of drives.
        calibration: calibration.json of `benchmarks.calibrate`; needed for a risk above 0.

    Raises:
        UsageError: if both risk and level are given, or a risk without a calibration.
        CalibrationError: if the calibration is for other settings, or only for larger risks.
    """
    if settings.risk == 0.0:
        return settings
    if settings.level > 0.0:
        raise UsageError("--level is in place of --risk: give one of them")
    if calibration is None:
        raise UsageError("--risk needs --calibration, a file that benchmarks.calibrate has written")
    found = Calibration.load(calibration)
    return replace(settings, level=found.level_for(settings.risk, conditions_of(settings)))
