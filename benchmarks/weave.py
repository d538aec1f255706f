"""How much the car weaves: changes of the sign of its curvature where the way is straight.

python -m benchmarks.weave results/corridor --out weave.json
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.infra.markdown import markdown
from predictor.infra.results_file import write_results

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.runs.saved_run import Run

COMMAND = "benchmarks.weave"
DESCRIPTION = """\
Count how often the car changes from one side to the other on straights, in runs of
benchmarks.corridor on a given route. Straight is where the given way turns by less than 10° within
3 m before and behind. Ticks on which the car drives straight, but for a curvature below a
threshold, do not count.
"""
STEP = 0.5
"""Between two points of the way at which its direction is taken [m]."""
AROUND = 6
"""Points before and behind within which it must keep its direction."""
TURN = np.radians(10.0)
"""Turn below which a way is straight [rad]."""
THRESHOLDS = (0.01, 0.05)
"""Curvatures above which the car is said to turn [1/m]."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    parser = OneLineParser(
        prog=COMMAND, description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("runs", metavar="DIR", nargs="+", type=Path, help="a saved run")
    parser.add_argument("--episodes", metavar="N", type=between(1, 10**9), default=100,
                        help="the first N of each run (default: %(default)s)")  # fmt: skip
    parser.add_argument("--out", metavar="FILE", type=Path, default=Path("results/weave.json"),
                        help="where the counts go (default: %(default)s)")  # fmt: skip
    return run_command(COMMAND, lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from benchmarks.runs.saved_run import Run
    from predictor.infra.environment import commit

    results = {"commit": commit(), "thresholds": THRESHOLDS,
               "runs": [counts(Run.load(path), args.episodes) for path in args.runs]}  # fmt: skip
    write_results(args.out, "weave", results)
    print(table(results), "", args.out, sep="\n")


def counts(run: Run, episodes: int) -> dict[str, Any]:
    """Return the metres on straights and the changes of sign of each arm, for each threshold.

    Raises:
        RunError: if the run is damaged, or its drives had no way in common.
    """
    from benchmarks.runs.trace import RunError

    if run.settings["route"] != "fixed":
        raise RunError(f"{run.directory}: its arms chose their ways; run it with --route fixed")
    arms: dict[str, Any] = {}
    for arm in run.arms:
        metres, changes = 0.0, [0] * len(THRESHOLDS)
        for index in run.indices[:episodes]:
            trace = run.trace(index, arm)
            xy, curvature = trace.states[:, :2], trace["controls"][:, 1].astype(float)
            way = np.vstack([xy[:1], run.archive.array(f"w{index}/waypoints")])
            for first, end in stretches(_on_straights(xy[:-1], way)):
                metres += float(np.hypot(*np.diff(xy[first : end + 1], axis=0).T).sum())
                for i, threshold in enumerate(THRESHOLDS):
                    changes[i] += sign_changes(curvature[first:end], threshold)
        arms[arm] = {"metres": metres, "changes": changes}
    commits = sorted({str(episode.commit) for episode in run.episodes})
    return {"label": run.label, "settings": run.settings, "commits": commits, "arms": arms}


def sign_changes(curvature: NDArray, threshold: float) -> int:
    """Return how often the curvatures above a threshold [1/m] change their sign; shape (N,)."""
    turning = curvature[np.abs(curvature) > threshold]
    return int((np.diff(np.sign(turning)) != 0).sum())


def stretches(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and end of each run of true values in an array of shape (N,)."""
    edges = np.flatnonzero(np.diff(np.r_[False, marked, False].astype(int)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _on_straights(points: NDArray, way: NDArray) -> NDArray[np.bool_]:
    """Return whether the point of a way nearest to each point lies on a straight, (N,)."""
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T))]
    at = np.arange(0.0, along[-1], STEP)
    path = np.column_stack([np.interp(at, along, way[:, i]) for i in (0, 1)])
    heading = np.unwrap(np.arctan2(*np.gradient(path, axis=0).T[::-1]))
    straight = np.array([np.ptp(heading[max(0, i - AROUND) : i + AROUND + 1]) < TURN
                         for i in range(len(at))])  # fmt: skip
    nearest = [int(np.argmin(np.hypot(*(path - point).T))) for point in points]
    return straight[nearest]


def table(results: dict[str, Any]) -> str:
    """Return the changes of sign for 100 m of straight as Markdown, a line for each run."""
    arms = list(dict.fromkeys(arm for run in results["runs"] for arm in run["arms"]))
    rows = [["run", "turning above [1/m]", *(f"`{arm}`" for arm in arms)]]
    for run in results["runs"]:
        for i, threshold in enumerate(results["thresholds"]):
            rates = [run["arms"].get(arm) for arm in arms]
            rows.append([run["label"], f"{threshold:g}",
                         *("" if a is None else f"{100 * a['changes'][i] / a['metres']:.2f}"
                           for a in rates)])  # fmt: skip
    return markdown(rows)


if __name__ == "__main__":
    sys.exit(main())
