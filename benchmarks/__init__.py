"""Comparisons of drives with and without prediction, and everything else that is measured."""

import sys

import predictor

if not hasattr(predictor, "__path__"):
    # As in predictor/__init__.py, which has this done for the other packages.
    _line = (
        f"{predictor.__file__} hides the package predictor of foresee: give the command in "
        "another folder, or as `foresee` followed by its name"
    )
    if sys.argv[:1] == ["-m"]:
        print(_line, file=sys.stderr)
        raise SystemExit(2)
    raise ImportError(_line)
