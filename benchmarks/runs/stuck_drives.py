"""The causes of stuck drives: when the goal could last be reached on the true map."""

from __future__ import annotations

from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.saved_run import Run
from benchmarks.runs.trace import RunError
from predictor.infra.markdown import markdown
from predictor.mapping.car_limits import CarLimits
from predictor.mapping.conventions import TICK
from sim.task import reachable
from sim.world import World

STRIDE = 5
"""Ticks between two states that are tried."""
LONGEST = 120.0
"""Length of the longest way that is tried [m]."""
CLOSE = 1.0
"""A way that comes this close to the goal reaches it [m]."""
LATE = 4.0
"""A drive missed the last way out if it had one at most this long before its end [s]."""


def causes(run: Run) -> dict[str, Any]:
    """Return the causes of a run's stuck drives, and how many drives each arm made.

    Raises:
        RunError: if the run is damaged, or its car has a reverse gear, which the search lacks.
    """
    if run.settings["vehicle"] != "dubins":
        raise RunError(
            f"{run.directory}: drives of {run.settings['vehicle']}; the search knows "
            "the dubins car alone"
        )
    stuck = [episode for episode in run.episodes if episode.outcome == "stuck"]
    drives = {arm: sum(e.arm == arm for e in run.episodes) for arm in run.arms}
    found = [cause(run, e) for e in tqdm(stuck, desc=run.label, unit="stuck drive")]
    return {"label": run.label, "settings": run.settings, "drives": drives, "stuck": found}


def cause(run: Run, episode: DriveResult) -> dict[str, Any]:
    """Return when a stuck drive could last have reached its goal.

    Raises:
        RunError: if the run is damaged.
    """
    index, arm = episode.index, episode.arm
    world = World(episode.world, run.truth(index))
    states = run.trace(index, arm).states
    car, goal = CarLimits(v_max=run.setting("v_max", 4.0)), np.array(episode.goal)
    # Standing still is no way back.
    moved = np.flatnonzero(states[:, 3] > 0)
    end = min(int(moved[-1]) + 1, len(states) - 1) if len(moved) else 0
    before, speed = None, None
    for tick in (*range(end, 0, -STRIDE), 0):
        x, y, yaw, v = map(float, states[tick])
        poses = reachable(world, (x, y, yaw), car, LONGEST)
        if (np.hypot(*(poses[:, :2] - goal).T) <= CLOSE).any():
            before, speed = (end - tick) * run.setting("dt", TICK), v
            break
    return {"index": index, "arm": arm, "world": episode.world, "seconds": before, "speed": speed}


def table(results: dict[str, Any]) -> str:
    """Return the causes as Markdown, a line for each arm of each run."""
    rows = [
        [
            "run",
            "arm",
            "drives",
            "stuck",
            "way on from the end",
            f"missed within {LATE:g} s",
            "speed there [m/s]",
            "in a pocket for longer",
            "none found",
        ]
    ]
    for run in results["runs"]:
        for arm, drives in run["drives"].items():
            stuck = [one for one in run["stuck"] if one["arm"] == arm]
            times = [one["seconds"] for one in stuck if one["seconds"] is not None]
            late = [
                one["speed"]
                for one in stuck
                if one["seconds"] is not None and 0 < one["seconds"] <= LATE
            ]
            speeds = f"{min(late):.1f}–{max(late):.1f}" if late else ""
            counts = (
                drives,
                len(stuck),
                times.count(0.0),
                len(late),
                speeds,
                sum(time > LATE for time in times),
                len(stuck) - len(times),
            )
            rows.append([run["label"], f"`{arm}`", *map(str, counts)])
    return markdown(rows)
