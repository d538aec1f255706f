"""What has been seen of a building, and what is believed of the rest.

A predictor is any object with `predict(known: Grid, pose) -> Prediction`; run `check_predictor`
on one of your own. Names are imported when they are first used, so that a command's --help does
not wait for the packages that only its work needs.
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

HOMES = {
    "FREE": "mapping.grid",
    "OCCUPIED": "mapping.grid",
    "UNKNOWN": "mapping.grid",
    "BadPredictionError": "prediction",
    "Body": "mapping.body",
    "Grid": "mapping.grid",
    "GridFrame": "mapping.grid",
    "NoPrediction": "none",
    "OccupancyGrid": "mapping.grid",
    "Prediction": "prediction",
    "Predictor": "prediction",
    "PredictorError": "registry",
    "Scan": "mapping.scan",
    "available": "registry",
    "check_predictor": "checking",
    "checked": "prediction",
    "load_predictor": "registry",
}
"""Name → the module of this package that defines it."""

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


def _refuse_hidden_packages() -> None:
    """Say in one line which file of the user's hides a package of this project.

    `python -m` looks into the working folder first, where a `sim.py` may lie.

    Raises:
        ImportError: if one does and this is no command.
        SystemExit: if one does and this is a command.
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
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
