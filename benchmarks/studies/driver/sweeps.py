"""Compare scores of a prediction that could limit how far a car drives into unobserved space.

    python -m benchmarks.studies.driver.sweeps results/corridor --out sweeps.json

The drives are those of the arm known in runs of benchmarks.corridor. At every eighth tick the car's
body is swept along arcs that leave the observed space. Each score falls along an arc; the car may
follow the arc as long as the score is above a threshold. An arc is wrong if the car would hit
something on that part of it. For each accepted share of wrong arcs, the table gives the mean
distance beyond the observed space at the best threshold.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from benchmarks.studies.driver.analysis import command
from foresee.infra.markdown import interval, records

if TYPE_CHECKING:
    from benchmarks.runs.saved_run import Run


def distances(run: Run) -> dict[str, Any]:
    """Return the mean distance beyond the observed space for each score and share of wrong arcs.

    Raises:
        RunError: if the run is damaged.
        UsageError: if it has no drives of the arm `known`, or its LIDAR was noisy.
    """
    # Imported here, so that --help and bad arguments do not wait for slow imports.
    from benchmarks.studies.driver.arcs import reliable_distances

    return reliable_distances(run)


def table(results: dict[str, Any]) -> str:
    """Return the mean distances beyond the observed space [m] as a Markdown table."""
    return records(
        [
            {"run": run["label"], "score": name}
            | {f"{100 * mean['share']:g} % wrong": interval(mean, ".2f") for mean in means}
            for run in results["runs"]
            for name, means in run["scores"].items()
        ]
    )


main = command("sweeps", __doc__, distances, table)

if __name__ == "__main__":
    sys.exit(main())
