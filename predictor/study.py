"""Train the paper's four networks (three and a perceptron as baseline) at five expansions each.

    python -m predictor.study --preset short        all 20, in about two hours on 2 cores
    python -m predictor.study                       as in the paper: months without a GPU
    python -m predictor.study --epochs 2 --batch 32 --bf16 --minutes 20       20 minutes on a GPU

The most important trainings come first, so that a study can be stopped at any time. The same
command continues it: finished trainings are skipped, interrupted ones are resumed.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from itertools import product
from pathlib import Path
from typing import Any

from foresee.infra.command_line import OneLineParser, between, run_command
from predictor.data import SIMULATED
from predictor.networks import PAPER, PROPOSED
from predictor.networks.image_config import EXPANSIONS
from predictor.training.image_arguments import add_arguments, configured

FIRST = (1.1, 1.3, 2.0)
"""Most important expansions, which are trained first."""
OTHERS = tuple(x for x in EXPANSIONS if x not in FIRST)
ORDER = (*product(PROPOSED, FIRST), *product(PROPOSED, OTHERS), *product(("mlp",), EXPANSIONS))
"""All trainings, the most important first."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 if a training failed, 2 for bad arguments, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.study",
        description="Train the paper's networks at its five expansions, the most important first. "
        "Interrupted, it continues when the same command is given again. OUT/status.txt lists the "
        "state of each training.",
    )
    told = {
        "data": "folder of frames that predictor.dataset has made (default: %(default)s)",
        "out": "folder of results, with a folder for each training: checkpoint, log, curve, "
        "weights (default: results/study-PRESET)",
        "archs": f"architectures to train, of {', '.join(PAPER)} (default: all)",
        "expansions": "width of the predicted square divided by the 5 m of the crop, of "
        f"{', '.join(map(str, EXPANSIONS))} (default: all)",
        "jobs": "number of trainings at a time, with one thread each (default: one for each core; "
        "1 with a GPU)",
        "minutes": "stop after this many minutes; the same command continues (default: no limit)",
        "seed": "seed of the first weights and of the frames' order (default: 0)",
    }
    archs: dict[str, Any] = {"nargs": "+", "choices": PAPER, "default": PAPER}
    expansions: dict[str, Any] = {
        "nargs": "+",
        "type": float,
        "choices": EXPANSIONS,
        "default": EXPANSIONS,
    }
    minutes = between(1e-3, math.inf)
    add = parser.add_argument
    add("--data", type=Path, default=SIMULATED, metavar="DIR", help=told["data"])
    add("--out", type=Path, metavar="DIR", help=told["out"])
    add("--archs", metavar="A", help=told["archs"], **archs)
    add("--expansions", metavar="X", help=told["expansions"], **expansions)
    add("--jobs", type=between(1, 10_000), metavar="N", help=told["jobs"])
    add("--minutes", type=minutes, default=math.inf, metavar="M", help=told["minutes"])
    add_arguments(parser)
    add("--batch", type=int, metavar="N", help="frames per optimiser step (default: the preset's)")
    add("--rate", type=float, metavar="R", help="learning rate (default: the preset's)")
    add("--seed", type=int, metavar="N", help=told["seed"])
    return run_command("predictor.study", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    from predictor.training.image_training import frames_of
    from predictor.training.parallel_trainings import Study, Training

    out = args.out or Path("results") / f"study-{args.preset or 'paper'}"
    train, validation = frames_of(args.data)
    digests = train.digest, validation.digest
    trainings = [
        Training(*configured(args, arch, x), args.data, digests, out / f"{arch}-{x:.1f}")
        for arch, x in ORDER
        if arch in args.archs and x in args.expansions
    ]
    # Free their memory for the trainings.
    del train, validation
    study = Study(trainings, out)
    study.train(args.jobs or _at_a_time(), args.minutes)
    print(study.table())
    return 1 if study.failures() else 0


def _at_a_time() -> int:
    import torch

    return 1 if torch.cuda.is_available() else os.cpu_count() or 1


if __name__ == "__main__":
    sys.exit(main())
