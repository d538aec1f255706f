"""Compare scores that could decide how far a car may rely on a prediction.

python -m benchmarks.sweeps results/corridor --out sweeps.json
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from benchmarks.runs.analysis import analyse
from predictor.infra.markdown import interval, records

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run

DESCRIPTION = """\
Compare scores that could decide how far a car may rely on a prediction, on drives of the arm known
in runs of benchmarks.corridor. At every eighth tick the car's body is swept along arcs that leave
the observed space. A score goes with each arc, and falls along it; the car may follow the arc as
far as the score is above a threshold. For each share of wrong arcs, on which something is in the
way, the table has the mean distance beyond the observed space at the best threshold.
"""


def distances(run: Run) -> dict[str, Any]:
    """Return, for each score and share of wrong arcs, how far the car may rely on predictions.

    Raises:
        RunError: if the run is damaged.
        UsageError: if it has no drives of the arm `known`, or its LIDAR was noisy.
    """
    # Here and not above, so that --help and bad arguments answer at once.
    from benchmarks.risk_study.arcs import distances_of

    return distances_of(run)


def table(results: dict[str, Any]) -> str:
    """Return the mean distances beyond the observed space [m] as Markdown."""
    return records(
        [
            {"run": run["label"], "score": name}
            | {f"{100 * one['share']:g} % wrong": interval(one, ".2f") for one in found}
            for run in results["runs"]
            for name, found in run["scores"].items()
        ]
    )


def main(argv: list[str] | None = None) -> int:
    """Run the command line; return its exit status, 2 for bad input."""
    return analyse("sweeps", distances, table, DESCRIPTION, argv)


if __name__ == "__main__":
    sys.exit(main())
