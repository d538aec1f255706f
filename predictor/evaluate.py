"""Score predictors on what the car had not seen, over generated worlds and real maps.

python -m predictor.evaluate --help
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.scoring.evaluate_config import EvaluateConfig


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    default = EvaluateConfig()
    parser = OneLineParser(
        prog="predictor.evaluate",
        description="Score predictors on the cells that the car had not seen, along drives of its "
        "own planner without prediction. The last predictor named gets a sheet of pictures. "
        "Interrupted, it goes on where it was: give the same command again.",
    )
    add = parser.add_argument
    add("--world", nargs="+", default=list(default.world), metavar="W",
        help="families of generated worlds, map_server .yaml files, folders of them (default: "
        f"{' '.join(default.world)})")  # fmt: skip
    add("--predictors", nargs="+", default=list(default.predictors), metavar="P",
        help="names, module:Class, FILE.safetensors (default: "
        f"{' '.join(default.predictors)})")  # fmt: skip
    add("--drives", type=between(1, 10**6), default=default.drives, metavar="N",
        help="in each family, and in each map (default: %(default)s)")  # fmt: skip
    add("--seed", type=between(0, 2**31), default=default.seed, metavar="N",
        help="of the first drive (default: %(default)s)")  # fmt: skip
    add("--window", type=between(1.0, 100), default=default.window, metavar="M",
        help="side of the square in which the LIDAR is used [m] (default: "
        "%(default)s)")  # fmt: skip
    add("--expansion", type=between(1.0, 4), default=default.expansion, metavar="X",
        help="width of the predicted square over that of the window (default: "
        "%(default)s)")  # fmt: skip
    parser.add_jobs()
    add("--out", type=Path, default=Path("results/evaluate"), metavar="DIR", help="scores and "
        "pictures (default: %(default)s)")  # fmt: skip
    return run_command("predictor.evaluate", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    from benchmarks.recording.evaluation import Evaluation, table
    from predictor.infra.environment import several_states

    config = EvaluateConfig(tuple(args.world), tuple(args.predictors), args.drives, args.seed,
                            args.window, args.expansion)  # fmt: skip
    evaluation = Evaluation(config, args.out)
    evaluation.run(args.jobs)
    results = evaluation.finish()
    mixed = several_states(results["commits"], "drives")
    print(*filter(None, [table(results), mixed, str(args.out / "results.json")]), sep="\n\n")


if __name__ == "__main__":
    sys.exit(main())
