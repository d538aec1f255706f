"""Score predictors on unobserved cells, along drives in generated buildings and in real maps.

    foresee evaluate --world office maps/ --predictors extend compact

The drives are those of the project's own planner without prediction. Example images are drawn for
the last predictor. Interrupted, it continues when the same command is given again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from foresee.infra.command_line import Command
from foresee.infra.options import Options, jobs_option, option
from predictor.evaluation.settings import EvaluateConfig


@dataclass(frozen=True)
class Place(Options):
    """Options of where scores are computed and saved; none of them changes a result."""

    jobs: int = jobs_option()
    out: Path = option(Path("results/evaluate"), "folder of scores and pictures", "DIR")


def _run(config: EvaluateConfig, place: Place) -> None:
    # Imported here, so that --help does not wait for slow imports.
    from foresee.infra.environment import several_states
    from predictor.evaluation.drive_scores import DriveScores, table

    scores = DriveScores(config, place.out)
    for note in scores.folder.notes:
        print(f"warning: {note}", file=sys.stderr)
    scores.run(place.jobs)
    results = scores.finish()
    mixed = several_states(results["commits"], "drives")
    print(*filter(None, [table(results), mixed, str(place.out / "results.json")]), sep="\n\n")


main = Command("predictor.evaluate", __doc__, _run)

if __name__ == "__main__":
    sys.exit(main())
