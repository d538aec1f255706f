"""Maps of what a robot has observed, and predictors of the part that it has not observed.

A predictor is any object with `predict(known: Grid, pose) -> Prediction`; `check_predictor` tests
one of your own. The names below are imported when they are first used, so that the --help of a
command does not wait for slow imports.
"""

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predictor.checking import check_predictor
    from predictor.mapping.body import Body
    from predictor.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame, OccupancyGrid
    from predictor.mapping.scan import Scan
    from predictor.none import NoPrediction
    from predictor.prediction import BadPredictionError, Prediction, Predictor, checked
    from predictor.registry import PredictorError, available, load_predictor

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "BadPredictionError",
    "Body",
    "Grid",
    "GridFrame",
    "NoPrediction",
    "OccupancyGrid",
    "Prediction",
    "Predictor",
    "PredictorError",
    "Scan",
    "available",
    "check_predictor",
    "checked",
    "load_predictor",
]

HOMES = ("mapping.grid", "mapping.body", "mapping.scan", "prediction", "none", "checking")
"""Modules that define the names in `__all__`, the quickest to import first; `registry` defines the
rest."""


def _refuse_hidden_packages() -> None:
    """Raise an error if a file of the user, such as `sim.py`, hides a package of this project.

    `python -m` imports from the working folder first. A command reports the file in one line and
    exits.
    """
    root = Path(__file__).resolve().parents[1]
    for name in ("planner", "sim", "benchmarks"):
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None or root in Path(spec.origin).resolve().parents:
            continue
        line = (
            f"{spec.origin} hides the package {name} of foresee: give the command in another "
            "folder, or as `foresee` followed by its name"
        )
        if sys.argv[:1] == ["-m"]:
            print(line, file=sys.stderr)
            raise SystemExit(2)
        raise ImportError(line)


_refuse_hidden_packages()


def __getattr__(name: str) -> Any:
    if name in __all__:
        for module in (*HOMES, "registry"):
            found = importlib.import_module(f"{__name__}.{module}")
            if hasattr(found, name):
                return getattr(found, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
