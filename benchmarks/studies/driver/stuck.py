"""Find out why drives got stuck: the last moment at which the goal could still be reached.

    python -m benchmarks.studies.driver.stuck results/real --out stuck.json

For each stuck drive of the dubins car in a run of benchmarks.corridor, a search over the true map
tries to reach the goal from where the car stands, then from ever earlier states of the drive. The
search is that of sim.task, not the planner's; it keeps about 0.1 m from walls.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.studies.driver.analysis import command
from foresee.infra.command_line import UsageError
from foresee.infra.markdown import records
from foresee.infra.progress import progress

if TYPE_CHECKING:
    from benchmarks.runs.drive_result import DriveResult
    from benchmarks.runs.saved_run import Run

STRIDE = 5
"""Number of ticks between two states from which the search is tried."""
LONGEST = 120.0
"""Length of the longest path of the search [m]."""
CLOSE = 1.0
"""Distance from the goal at which a path counts as reaching it [m]."""
LATE = 4.0
"""Time before the end of a drive that separates a missed way out (later) from a dead end
(earlier) [s]."""


def causes(run: Run) -> dict[str, Any]:
    """Return the cause of each stuck drive of a run, and the number of drives of each arm.

    Raises:
        RunError: if the run is damaged.
        UsageError: if its car is not the default one without a reverse gear.
    """
    if run.settings["vehicle"] != "dubins" or run.settings["car"] is not None:
        raise UsageError(
            f"{run.directory} holds drives of the car "
            f"{run.settings['car'] or run.settings['vehicle']}; the search is for the default "
            "dubins car only"
        )
    stuck = [episode for episode in run.episodes if episode.outcome == "stuck"]
    drives = {arm: sum(e.arm == arm for e in run.episodes) for arm in run.arms}
    entries = [cause(run, e) for e in progress(stuck, desc=run.label, unit="stuck drive")]
    return {"drives": drives, "stuck": entries}


def cause(run: Run, episode: DriveResult) -> dict[str, Any]:
    """Return how long before its end a stuck drive could still have reached its goal [s].

    Raises:
        RunError: if the run is damaged.
    """
    from foresee.mapping.car_limits import CarLimits
    from sim.task import reachable
    from sim.world import World

    index, arm = episode.index, episode.arm
    trace = run.trace(index, arm)
    world, states = World(episode.world, trace.truth), trace.states
    goal = np.array(episode.goal)
    # The search starts at the last state in which the car still moved.
    moved = np.flatnonzero(states[:, 3] > 0)
    end = min(int(moved[-1]) + 1, len(states) - 1) if len(moved) else 0
    before, speed = None, None
    for tick in (*range(end, 0, -STRIDE), 0):
        x, y, yaw, v = map(float, states[tick])
        poses = reachable(world, (x, y, yaw), CarLimits(), LONGEST)
        if (np.hypot(*(poses[:, :2] - goal).T) <= CLOSE).any():
            before, speed = (end - tick) * run.setting("dt"), v
            break
    return {"index": index, "arm": arm, "world": episode.world, "seconds": before, "speed": speed}


def table(results: dict[str, Any]) -> str:
    """Return the causes as a Markdown table, one line for each arm of each run."""
    rows = []
    for run in results["runs"]:
        for arm, drives in run["drives"].items():
            stuck = [drive for drive in run["stuck"] if drive["arm"] == arm]
            timed = [drive for drive in stuck if drive["seconds"] is not None]
            late = [drive["speed"] for drive in timed if 0 < drive["seconds"] <= LATE]
            rows.append(
                {
                    "run": run["label"],
                    "arm": f"`{arm}`",
                    "drives": drives,
                    "stuck": len(stuck),
                    "reachable from the final state": sum(drive["seconds"] == 0 for drive in timed),
                    f"missed within {LATE:g} s": len(late),
                    "speed then [m/s]": f"{min(late):.1f}–{max(late):.1f}" if late else "",
                    "in a dead end": sum(drive["seconds"] > LATE for drive in timed),
                    "no path found": len(stuck) - len(timed),
                }
            )
    return records(rows)


main = command("stuck", __doc__, causes, table)

if __name__ == "__main__":
    sys.exit(main())
