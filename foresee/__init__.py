"""The public names of the project, and the base that all its packages build on.

    from foresee import drive, plot

`mapping` has grids, scans and the car's shape; `prediction`, `frontiers` and `checking` define what
a predictor is; `infra` serves the command lines, the options, the worker processes and the files.

A public name is imported when it is first used: a user of one package does not wait for the others.
"""

import importlib
import importlib.util
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

_HOMES = {
    "Grid": "foresee.mapping.grid",
    "Navigator": "planner.navigator",
    "NavigatorConfig": "planner.navigator_config",
    "Prediction": "foresee.prediction",
    "Predictor": "foresee.prediction",
    "PredictorProcess": "planner.risk.predictor_process",
    "Scan": "foresee.mapping.scan",
    "SearchProcess": "planner.guide.search_process",
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


_ROOT = Path(__file__).resolve().parents[1]
_PACKAGES = ("sim", "planner", "predictor", "benchmarks")


def _is_command() -> bool:
    """Return whether the program is `foresee`, or a worker process of it, which has its `argv`."""
    program = Path(sys.argv[0] if sys.argv else "")
    return (
        program.stem == "foresee"
        or program == Path(__file__).with_name("__main__.py")
        or sys.orig_argv[1:3] == ["-m", "foresee"]
    )


def _refuse_hidden_packages() -> None:
    """Raise an error if a file of the user, such as `sim.py`, hides a package of this project.

    `python -m` imports from the working folder first. A command reports the file in one line and
    exits.
    """
    for name in _PACKAGES:
        spec = importlib.util.find_spec(name)
        # A folder that only has the name of a package is no module that the user needs.
        if spec is None or spec.origin is None or _ROOT in Path(spec.origin).resolve().parents:
            continue
        line = (
            f"{spec.origin} hides the package {name} of foresee: give the command in another "
            "folder, or as `foresee` followed by its name"
        )
        if sys.argv[:1] == ["-m"]:
            print(line, file=sys.stderr)
            raise SystemExit(2)
        raise ImportError(line)


class _OwnPackages:
    """A finder of this project's packages that folders and files of the same names cannot hide."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [str(_ROOT)]) if name in _PACKAGES else None


if not _is_command():
    _refuse_hidden_packages()
sys.meta_path.insert(0, _OwnPackages)
