"""Score predictors on unobserved cells, along drives in generated buildings and in real maps.

python -m predictor.evaluate --help
"""

from __future__ import annotations

import argparse
import sys

from foresee.infra.command_line import OneLineParser, run_command
from predictor.evaluation.settings import EvaluateConfig


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.evaluate",
        description="Score predictors on the cells that the car had not observed, along drives of "
        "the project's own planner without prediction. Example images are drawn for the last "
        "predictor. Interrupted, it continues when the same command is given again.",
    )
    EvaluateConfig.add_to(parser)
    parser.add_jobs()
    parser.add_out("results/evaluate", "folder of scores and pictures", "DIR")
    return run_command("predictor.evaluate", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from foresee.infra.environment import several_states
    from predictor.evaluation.drive_scores import DriveScores, table

    scores = DriveScores(EvaluateConfig.of(args), args.out)
    scores.run(args.jobs)
    results = scores.finish()
    mixed = several_states(results["commits"], "drives")
    print(*filter(None, [table(results), mixed, str(args.out / "results.json")]), sep="\n\n")


if __name__ == "__main__":
    sys.exit(main())
