"""The race: the drives of several arms in one building, side by side, with running clocks."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray

from benchmarks.figures.animation import Ticks
from benchmarks.figures.drive_view import side_by_side
from benchmarks.runs.arms import arm_kind, arm_risk
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from foresee.infra.drawing import own_style

ARMS = {
    "known": "plans within what it has seen",
    "backup": "hopes that the rest is free",
    "predicted": "relies on a network",
}
"""Kind of arm that races → what it does, in a few words."""
MOST = 150
"""Largest number of frames."""
DPI = 100


def racers(run: Run, index: int) -> list[str]:
    """Return the arms that race in an episode: of `predicted`, the one at the highest risk.

    Raises:
        RunError: if there is no such episode, or fewer than two of `ARMS` drove it.
    """
    driven = run.driven_arms(index)
    boldest = {arm_kind(arm): arm for arm in sorted(driven, key=arm_risk)}
    arms = [boldest[kind] for kind in ARMS if kind in boldest]
    if len(arms) < 2:
        raise RunError(
            f"{run.directory}: a race needs two of the arms {', '.join(ARMS)}, and episode {index} "
            f"has {', '.join(driven)}"
        )
    return arms


class Race(Ticks):
    """The frames of a race, drawn one by one by `frame`, in real time.

    Args:
        run: run that contains the drives.
        index: number of the episode; None: the first in which all arms reached the goal.
        stride: number of ticks from frame to frame; None: the smallest that gives at most `MOST`
            frames.

    Attributes:
        index: number of the episode.

    Raises:
        RunError: if there is no such episode, fewer than two of `ARMS` drove it, or a trace is
            broken.
    """

    @own_style()
    def __init__(self, run: Run, index: int | None = None, stride: int | None = None) -> None:
        self.index = index = run.showcase if index is None else index
        arms = racers(run, index)
        traces = [run.trace(index, arm) for arm in arms]
        longest = max(len(trace.plans) for trace in traces)
        stride = math.ceil(longest / MOST) if stride is None else stride
        super().__init__(longest, run.setting("dt"), stride)
        figure, self._views = side_by_side(run, index, {arm: ARMS[arm_kind(arm)] for arm in arms})
        figure.set_dpi(DPI)
        self._canvas = FigureCanvasAgg(figure)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Draw one frame, and return its pixels, (height, width, 3)."""
        for view in self._views:
            view.update(self.ticks[number])
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
