"""Compare predictors on the data of the prediction study.

python -m benchmarks.studies.katyal2018 --help
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from foresee.infra.command_line import OneLineParser, between, run_command
from predictor.data import PHYSICAL, SIMULATED
from predictor.networks.image_config import EXPANSIONS

PREDICTORS = ("none", "extend", "compact", "compact-logs", "compact-paper")
"""Default predictors."""
DESCRIPTION = """\
Compare predictors on the data sets of the prediction study, simulated and from real logs: by the
similarity of their images to the truth (SSIM) and by scores of their probabilities on unobserved
cells, at each expansion of the 5 m crop. The values of the paper are shown beside them. Two
baselines are always included: `copy`, the unchanged input, and `grey`, an image that is all grey.
Interrupted, it continues when the same command is given again. Predictors and expansions can be
added to a folder at any time.
"""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    parser = OneLineParser(
        prog="benchmarks.studies.katyal2018",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    told = {
        "out": "folder of results.json, tables.md and the figures (default: %(default)s)",
        "data": "folder of the simulated data set of predictor.dataset, whose splits test and more "
        f"are scored (default: {SIMULATED}, which may be missing if there are logs)",
        "logs": "folder of a data set of predictor.dataset --log; or logs, or folders of logs, of "
        f"which a data set is made in OUT/physical (default: {PHYSICAL}, if it exists)",
        "predictors": "none, extend, compact, compact-logs, compact-paper, module:Class, "
        "FILE.safetensors; a folder of predictor.study, whose networks are compared at the "
        "expansion that they were trained for; or fused:FOLDER/ARCH, which combines them. NAME=P "
        "renames a predictor. Figures show the first eight that predict something "
        f"(default: {' '.join(PREDICTORS)})",
        "expansions": "side of the predicted square divided by 5 m, of 1.02, 1.04, … 2.00 "
        f"(default: {' '.join(map(str, EXPANSIONS))})",
        "apart": "least distance along the drive from one scored frame to the next [m]; 0: all "
        "frames are scored (default: %(default)s)",
    }
    out, apart = Path("results/prediction"), between(0.0, 1000)
    expansions: dict[str, Any] = {"nargs": "+", "type": _expansion, "default": EXPANSIONS}
    add = parser.add_argument
    add("--out", type=Path, default=out, metavar="DIR", help=told["out"])
    add("--data", type=Path, metavar="DIR", help=told["data"])
    add("--logs", type=Path, nargs="+", metavar="PATH", help=told["logs"])
    add("--predictors", nargs="+", default=PREDICTORS, metavar="P", help=told["predictors"])
    add("--expansions", metavar="X", help=told["expansions"], **expansions)
    add("--apart", type=apart, default=0.5, metavar="M", help=told["apart"])
    parser.add_jobs()
    return run_command("benchmarks.studies.katyal2018", lambda: _run(parser.parse_args(argv)))


def _expansion(text: str) -> float:
    """Return an expansion whose square is an even number of cells wide."""
    expansion: float = between(1.02, 2.0)(text)
    if abs(50 * expansion - round(50 * expansion)) > 1e-6:
        raise argparse.ArgumentTypeError(f"{text} is none of 1.02, 1.04, … 2.00")
    return round(expansion, 2)


def _run(args: argparse.Namespace) -> None:
    import torch

    from benchmarks.studies.katyal2018.contestants import contestants
    from benchmarks.studies.katyal2018.cost import costs_of, published_costs
    from benchmarks.studies.katyal2018.evaluation import Evaluation
    from benchmarks.studies.katyal2018.figures import draw
    from benchmarks.studies.katyal2018.report import report
    from benchmarks.studies.katyal2018.tables import summary, tables_of
    from foresee.infra.atomic_file import write_whole
    from foresee.infra.environment import several_states
    from predictor.data.frames import MANIFEST

    torch.set_num_threads(1)
    args.out.mkdir(parents=True, exist_ok=True)
    expansions = tuple(sorted(set(args.expansions)))
    who = contestants(args.predictors, expansions)
    logs, data = _logs(args), args.data
    if data is None and (logs is None or (SIMULATED / MANIFEST).is_file()):
        data = SIMULATED
    evaluation = Evaluation(args.out, data, logs, expansions, args.apart, who)
    # Costs are measured first: they need an idle machine, and reveal invalid predictors early.
    costs, published = costs_of(evaluation), published_costs(evaluation)
    evaluation.run(args.jobs)
    results = report(evaluation, costs, published)
    write_whole(args.out / "tables.md", tables_of(results).encode())
    paths = [args.out / "results.json", args.out / "tables.md", *draw(evaluation, results)]
    mixed = several_states(results["commits"], "scores")
    print(*filter(None, [summary(results), mixed, "\n".join(map(str, paths))]), sep="\n\n")


def _logs(args: argparse.Namespace) -> Path | None:
    """Return the folder of the physical data set, made here if logs are given; None without one."""
    from predictor.data.bags import BagConfig
    from predictor.data.frames import MANIFEST
    from predictor.data.log_files import logs_in
    from predictor.recording.data_sets import make_physical

    logs: list[Path] = args.logs or [PHYSICAL]
    if len(logs) == 1 and (logs[0] / MANIFEST).is_file():
        return logs[0]
    if args.logs is None:
        return None
    folder: Path = args.out / "physical"
    make_physical(folder, logs_in(logs), BagConfig(), args.jobs)
    return folder


if __name__ == "__main__":
    sys.exit(main())
