"""Comparisons of drives with and without prediction.

The modules in this folder are commands, `python -m benchmarks.NAME`, which `foresee` lists, and
`compare`, the interface in Python. The subpackages do the work: `runs` has the settings, drives and
results of a comparison, `calibration` the certified levels, `optimal` time-optimal drives, and
`figures` the plots. `studies` holds the evidence for what the documents state; nothing imports it.
"""

import foresee

if not hasattr(foresee, "__path__"):
    # A file foresee.py of the user; foresee/__init__.py finds the other packages that are hidden.
    raise SystemExit(
        f"{foresee.__file__} hides the package foresee: give the command in another folder, or as "
        "`foresee` followed by its name"
    )
