"""Figures of saved runs and of predictors' scores.

`run_figures` lists the plots of `benchmarks.corridor`, each drawn by a module of its name;
`animation` and `video` make the video, `palette` has the common styles, and `scores` has the plots
of `predictor.evaluate` and `benchmarks.studies.katyal2018`.
"""

# Before the modules here import matplotlib.
import foresee.infra.drawing  # noqa: F401
