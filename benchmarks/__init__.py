"""Comparisons of drives with and without prediction, and all other measurements.

Each module in this folder is a command, `python -m benchmarks.NAME`; `foresee` lists them. The
subpackages do the work. `runs` has the settings, drives and results of a comparison, `figures` its
plots, and `risk_study` the groups of drives of `benchmarks.risk`.
"""

import sys

import predictor

if not hasattr(predictor, "__path__"):
    # predictor/__init__.py does the same for the other packages.
    _line = (
        f"{predictor.__file__} hides the package predictor of foresee: give the command in "
        "another folder, or as `foresee` followed by its name"
    )
    if sys.argv[:1] == ["-m"]:
        print(_line, file=sys.stderr)
        raise SystemExit(2)
    raise ImportError(_line)
