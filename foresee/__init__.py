"""The public names of the project, and the base that all its packages build on.

    from foresee import drive, plot

`mapping` has grids, scans and the car's shape; `prediction`, `frontiers` and `checking` define what
a predictor is; `infra` serves the command lines, the options, the worker processes and the files.

A public name is imported when it is first used: a user of one package does not wait for the others.
"""

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Any

_HOMES = {
    "Grid": "foresee.mapping.grid",
    "Navigator": "planner.navigator",
    "NavigatorConfig": "planner.navigator",
    "Prediction": "foresee.prediction",
    "Predictor": "foresee.prediction",
    "PredictorProcess": "planner.risk.predictor_process",
    "Scan": "foresee.mapping.scan",
    "View": "foresee.prediction",
    "check_predictor": "foresee.checking",
    "drive": "benchmarks.compare",
    "generate": "sim.families",
    "load_predictor": "predictor.registry",
    "load_world": "sim.map_server",
    "plot": "benchmarks.compare",
}
"""Public name → module that defines it; `__init__.pyi` says the same to type checkers."""
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


def _refuse_hidden_packages() -> None:
    """Raise an error if a file of the user, such as `sim.py`, hides a package of this project.

    `python -m` imports from the working folder first. A command reports the file in one line and
    exits.
    """
    root = Path(__file__).resolve().parents[1]
    for name in ("sim", "planner", "predictor", "benchmarks"):
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
