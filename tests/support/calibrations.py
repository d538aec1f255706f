"""Calibrations that nobody measured."""

import json

import numpy as np

from benchmarks.calibration.certificate import conditions_for
from benchmarks.runs.settings import Settings
from planner.risk.betting import capital

SETTINGS = Settings(world=("corridor", "narrow"), predictor="none")


def proof(certified, drives=200):
    """Return the tests, without a collision, of what a calibration certifies."""
    return [
        {
            "level": level,
            "drives": drives,
            "collided": 0,
            "capital": {
                risk: float(capital(np.zeros(drives), float(risk)).max())
                for risk, highest in certified.items()
                if level <= highest
            },
        }
        for level in sorted(set(certified.values()))
    ]


def written(path, **changes):
    """Write a calibration of `SETTINGS` with some changes, and return its path."""
    content = {
        "kind": "calibration",
        "conditions": conditions_for(SETTINGS),
        "confidence": 0.9,
        "certified": {"0.02": 0.003, "0.05": 0.01},
        "seed": 100,
    }
    content |= changes
    content.setdefault("levels", proof(content["certified"]))
    path.write_text(json.dumps(content))
    return path
