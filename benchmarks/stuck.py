"""Find out why drives got stuck: when the goal could last be reached, on the true map.

python -m benchmarks.stuck results/real --out stuck.json
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from benchmarks.runs.analysis import analyse
from predictor.infra.command_line import UsageError
from predictor.infra.markdown import records

if TYPE_CHECKING:
    from benchmarks.runs.drive_result import DriveResult
    from benchmarks.runs.saved_run import Run

DESCRIPTION = """\
Find out why drives of the dubins car got stuck. For each stuck drive of a run of
benchmarks.corridor, a search over the true map tries to reach the goal from where the car stands,
then from ever earlier states of the drive. The search is that of sim.task, not the planner's; it
keeps about 0.1 m from walls.
"""
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
        RunError: if the run is damaged.
        UsageError: if its car has a reverse gear, which the search lacks.
    """
    if run.settings["vehicle"] != "dubins":
        raise UsageError(
            f"{run.directory}: drives of {run.settings['vehicle']}; the search knows "
            "the dubins car alone"
        )
    stuck = [episode for episode in run.episodes if episode.outcome == "stuck"]
    drives = {arm: sum(e.arm == arm for e in run.episodes) for arm in run.arms}
    found = [cause(run, e) for e in tqdm(stuck, desc=run.label, unit="stuck drive")]
    return {"drives": drives, "stuck": found}


def cause(run: Run, episode: DriveResult) -> dict[str, Any]:
    """Return when a stuck drive could last have reached its goal.

    Raises:
        RunError: if the run is damaged.
    """
    from predictor.mapping.car_limits import CarLimits
    from predictor.mapping.conventions import TICK
    from sim.task import reachable
    from sim.world import World

    index, arm = episode.index, episode.arm
    world = World(episode.world, run.truth(index))
    states = run.trace(index, arm).states
    car = CarLimits(v_max=run.setting("v_max", 4.0), braking=run.setting("braking", 1.5))
    goal = np.array(episode.goal)
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
    rows = []
    for run in results["runs"]:
        for arm, drives in run["drives"].items():
            stuck = [one for one in run["stuck"] if one["arm"] == arm]
            timed = [one for one in stuck if one["seconds"] is not None]
            late = [one["speed"] for one in timed if 0 < one["seconds"] <= LATE]
            rows.append(
                {
                    "run": run["label"],
                    "arm": f"`{arm}`",
                    "drives": drives,
                    "stuck": len(stuck),
                    "reachable from the final state": sum(one["seconds"] == 0.0 for one in timed),
                    f"missed within {LATE:g} s": len(late),
                    "speed there [m/s]": f"{min(late):.1f}–{max(late):.1f}" if late else "",
                    "in a dead end": sum(one["seconds"] > LATE for one in timed),
                    "none found": len(stuck) - len(timed),
                }
            )
    return records(rows)


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    return analyse("stuck", causes, table, DESCRIPTION, argv)


if __name__ == "__main__":
    sys.exit(main())
