"""Figures of saved runs and of predictors' scores.

`run_figures` lists the plots of `benchmarks.corridor`, each drawn by a module of its name;
`animation` and `video` make the video, `drive_mcap` the file for Foxglove; `palette` has the common
styles.
"""

# Before the modules here import matplotlib.
import foresee.infra.drawing  # noqa: F401
