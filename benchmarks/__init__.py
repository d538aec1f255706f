"""Comparisons of drives with and without prediction, and all other measurements.

The modules in this folder are commands, `python -m benchmarks.NAME`, which `foresee` lists, and
`compare`, the interface in Python. The subpackages do the work. `runs` has the settings, drives and
results of a comparison, `figures` its plots, `recording` drives that become samples, `scoring` the
scores of predictions along drives, `risk_study` and `prediction` the two studies, and the others
what their names say.
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
