"""Calibrations that nobody measured."""

import json

from benchmarks.calibration.certificate import conditions_of
from benchmarks.runs.settings import Settings

SETTINGS = Settings(world=("corridor", "narrow"), predictor="none")


def written(path, **changes):
    """Write a calibration of `SETTINGS` with some changes, and return its path."""
    found = {
        "kind": "calibration",
        "conditions": conditions_of(SETTINGS),
        "confidence": 0.9,
        "certified": {"0.02": 0.003, "0.05": 0.01},
        "seed": 100,
        "levels": [{"drives": 200}, {"drives": 50}],
    }
    path.write_text(json.dumps(found | changes))
    return path
