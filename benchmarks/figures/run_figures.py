"""The figures of a saved run of `benchmarks.corridor`; a new plot is added in `draw_run`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.figures.file_name import file_name
from benchmarks.figures.moment import moment
from benchmarks.figures.speed_profile import speed_profile
from benchmarks.figures.trajectories import trajectories
from benchmarks.runs.saved_run import Run
from foresee.infra.drawing import save_figures


def draw_all(directory: Path) -> list[Path]:
    """Draw the figures of the run in a folder, save them there, and return their paths.

    Raises:
        RunError: if the folder holds no run that can be read.
    """
    return draw_run(Run.load(directory), directory)


def draw_run(run: Run, out: Path, episode: int | None = None, arm: str | None = None) -> list[Path]:
    """Draw speed_profile.png, trajectories.png and moment.png of a run, and return their paths.

    With an episode or an arm, the names tell it, see `file_name`.

    Args:
        run: run whose drives are drawn.
        out: folder for the files; made if it is missing.
        episode: number of the episode to draw; None: each figure chooses.
        arm: arm of moment.png; None: one that uses a prediction.

    Raises:
        RunError: if there is no such drive, or its trace is broken.
    """
    shown = None if episode is None else [episode]
    figures: list[tuple[str, Callable[[], Figure]]] = [
        (file_name("speed_profile", "png", episode), lambda: speed_profile([run], episode)),
        (file_name("trajectories", "png", episode), lambda: trajectories(run, shown)),
        (file_name("moment", "png", episode, arm), lambda: moment(run, episode, arm)),
    ]
    return save_figures(figures, out)
