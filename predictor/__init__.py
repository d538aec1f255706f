"""Predictors of the part of a map that a robot has not observed, and all that makes them.

The contract of a predictor is `foresee.prediction`. `registry` finds a predictor by its name; those
that ship are `none`, `distance`, `extend`, and `compact` with its variants. `networks`, `data` and
`training` make the weights, `recording` drives for the samples, and `evaluation` scores predictions
along drives.
"""

import importlib
import warnings
from typing import Any

import foresee

if not hasattr(foresee, "__path__"):
    # A file foresee.py of the user; foresee/__init__.py finds the other packages that are hidden.
    raise SystemExit(
        f"{foresee.__file__} hides the package foresee: give the command in another folder, or as "
        "`foresee` followed by its name"
    )

_MOVED = {
    "foresee.mapping.grid": ("FREE", "OCCUPIED", "UNKNOWN", "Grid", "GridFrame", "OccupancyGrid"),
    "foresee.mapping.body": ("Body",),
    "foresee.mapping.scan": ("Scan",),
    "foresee.prediction": ("BadPredictionError", "Prediction", "Predictor", "checked"),
    "foresee.checking": ("check_predictor",),
    "predictor.none": ("NoPrediction",),
    "predictor.registry": ("PredictorError", "available", "load_predictor"),
}
"""Module → names that plug-ins imported from `predictor` before there was `foresee`."""


def __getattr__(name: str) -> Any:
    for home, names in _MOVED.items():
        if name in names:
            line = f"import {name} from {home}: from predictor, it will not work in version 2"
            warnings.warn(line, DeprecationWarning, stacklevel=2)
            return getattr(importlib.import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
