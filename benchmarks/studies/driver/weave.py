"""Measure how the car drives on straights: its speed, and how often it weaves.

    python -m benchmarks.studies.driver.weave results/corridor --out weave.json

The runs of benchmarks.corridor must be on a prescribed route. The route is straight where it turns
by less than 10° from 3 m before to 3 m behind. Weaving is counted as changes of the sign of the
curvature; ticks with a curvature below the threshold are ignored.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.driver.analysis import command
from foresee.infra.command_line import UsageError
from foresee.infra.markdown import DASH, records
from foresee.mapping.polyline import arc_length, points_at

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run

STEP = 0.5
"""Distance between two points of the route at which its direction is computed [m]."""
AROUND = 6
"""Number of points before and behind a point over which a straight route keeps its direction."""
TURN = np.radians(10.0)
"""Change of direction below which the route is straight [rad]."""
THRESHOLDS = (0.01, 0.05)
"""Curvatures above which the car counts as turning [1/m]."""


def counts(run: Run) -> dict[str, Any]:
    """Return how each arm drives on straights.

    These are the distance [m], the median speed [m/s], and the changes of sign at each threshold.

    Raises:
        RunError: if the run is damaged.
        UsageError: if it was not driven on a prescribed route.
    """
    if run.settings["route"] != "fixed":
        raise UsageError(f"{run.directory}: its arms chose their routes; run it with --route fixed")
    arms: dict[str, Any] = {}
    for arm in run.arms:
        metres, changes, speeds = 0.0, [0] * len(THRESHOLDS), list[float]()
        for index in run.indices:
            if (index, arm) not in run.drives:
                # The run was interrupted, or a worker process died.
                continue
            trace = run.trace(index, arm)
            xy, curvature = trace.states[:, :2], trace.controls[:, 1].astype(float)
            route = np.vstack([xy[:1], trace.waypoints])
            for first, end in stretches(_on_straights(xy[:-1], route)):
                metres += float(np.hypot(*np.diff(xy[first : end + 1], axis=0).T).sum())
                speeds += trace.states[first:end, 3].tolist()
                for i, threshold in enumerate(THRESHOLDS):
                    changes[i] += sign_changes(curvature[first:end], threshold)
        speed = float(np.median(speeds)) if speeds else None
        arms[arm] = {"metres": metres, "speed": speed, "changes": changes}
    commits = sorted({str(episode.commit) for episode in run.episodes})
    return {"commits": commits, "thresholds": THRESHOLDS, "arms": arms}


def sign_changes(curvature: NDArray[Any], threshold: float) -> int:
    """Return how often curvatures (N,) above a threshold [1/m] change their sign."""
    turning = curvature[np.abs(curvature) > threshold]
    return int((np.diff(np.sign(turning)) != 0).sum())


def stretches(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return start and end index of each run of consecutive True values in an array (N,)."""
    edges = np.flatnonzero(np.diff(np.r_[False, marked, False].astype(int)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _on_straights(points: NDArray[Any], route: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which points (N, 2) are nearest to a straight part of a route, (N,).

    Args:
        points: points to test [m].
        route: points of the route, (n, 2) [m].
    """
    at = np.arange(0.0, arc_length(route)[-1], STEP)
    path = points_at(route, at)
    heading = np.unwrap(np.arctan2(*np.gradient(path, axis=0).T[::-1]))
    straight = np.array(
        [np.ptp(heading[max(0, i - AROUND) : i + AROUND + 1]) < TURN for i in range(len(at))]
    )
    nearest = [int(np.argmin(np.hypot(*(path - point).T))) for point in points]
    return straight[nearest]


def table(results: dict[str, Any]) -> str:
    """Return the speed on straights, and the changes of sign per 100 m of them, as Markdown.

    The table has a line for the speed and each threshold of each run, and a column for each arm.
    """
    arms = list(dict.fromkeys(arm for run in results["runs"] for arm in run["arms"]))
    rows = []
    for run in results["runs"]:
        found = run["arms"]
        lines = {
            "median speed [m/s]": {
                arm: f"{of['speed']:.2f}" if of.get("speed") else DASH for arm, of in found.items()
            }
        }
        for i, threshold in enumerate(run["thresholds"]):
            lines[f"changes of a curvature above {threshold:g}/m, per 100 m"] = {
                arm: f"{100 * of['changes'][i] / of['metres']:.1f}" if of["metres"] else DASH
                for arm, of in found.items()
            }
        for measure, values in lines.items():
            head = {"run": run["label"], "on straights": measure}
            rows.append(head | {f"`{arm}`": values.get(arm, "") for arm in arms})
    return records(rows)


main = command("weave", __doc__, counts, table)

if __name__ == "__main__":
    sys.exit(main())
