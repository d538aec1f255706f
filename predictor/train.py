"""Train a network: `compact`, or one of the paper's.

    python -m predictor.train                      compact; two hours on 2 cores with its drives
    python -m predictor.train --steps 200 --train 20 --validation 4      a small run, end to end
    python -m predictor.train --start predictor/compact.safetensors --rate 5e-4      fine-tuning
    python -m predictor.train --arch unet_ff --expansion 1.3 --preset short
    torchrun --nproc-per-node 4 -m predictor.train --arch unet_ff --batch 16      on 4 GPUs

The same command resumes a training that was interrupted.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.recording.settings import DrivesConfig
from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.mapping.families import FAMILIES
from predictor.networks import ARCHITECTURES
from predictor.networks.image_config import EXPANSIONS, PRESETS
from predictor.training.checkpoint import TrainError
from predictor.training.compact_config import TrainConfig
from predictor.training.image_arguments import NAMES, add_arguments, configured

if TYPE_CHECKING:
    import argparse

COMPACT = ("train", "validation", "steps", "start", "logs", "families")
"""Arguments of compact alone."""
IMAGES = ("expansion", *NAMES)
"""Arguments of the paper's networks alone."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("predictor.train", lambda: _run(_parser().parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    _check(args)
    path = _compact(args) if args.arch == "compact" else _images(args)
    # Only the first process of torchrun prints.
    if os.environ.get("RANK", "0") == "0":
        print(path)


def _images(args: argparse.Namespace) -> Path:
    from predictor.training.image_training import train_images

    expansion = EXPANSIONS[0] if args.expansion is None else args.expansion
    config, training = configured(args, args.arch, expansion)
    out = args.out or Path("results/networks") / f"{args.arch}-{expansion:g}"
    return train_images(config, training, args.data or Path("data/simulated"), out, args.jobs)


def _compact(args: argparse.Namespace) -> Path:
    from benchmarks.recording.training_drives import make
    from predictor.training.compact_training import CompactTrainer

    default, drives = TrainConfig(), DrivesConfig()
    data, out = args.data or drives.out, args.out or Path("results/train")
    count, tuned_on = args.train or drives.train, args.validation or drives.validation
    start = None
    if args.start is not None:
        from predictor.networks.compact_net import CompactNet
        from predictor.weights import WeightsError, load_weights

        try:
            start = load_weights(args.start, CompactNet)
        except WeightsError as error:
            raise TrainError(f"--start: {error}") from None
    families = tuple(args.families or drives.families)
    # Now, so that an unusable folder is an error before hours of drives.
    out.mkdir(parents=True, exist_ok=True)
    make(DrivesConfig(data, count, tuned_on, logs=args.logs, families=families), args.jobs)
    # Imported after the drives, since their processes do not need it.
    import torch

    from predictor.data.samples import Samples, check_apart

    torch.set_num_threads(args.jobs)
    train = Samples.load(data / "train", count)
    validation = Samples.load(data / "validation", tuned_on)
    check_apart({"train": train, "validation": validation})
    config = TrainConfig(
        args.steps or default.steps,
        args.batch or default.batch,
        args.rate or default.rate,
        seed=args.seed or default.seed,
        start=start and start[1]["fingerprint"],
    )
    return CompactTrainer(config, train, validation, out, start).run()


def _check(args: argparse.Namespace) -> None:
    """Refuse arguments of other networks.

    Raises:
        TrainError: if there is one.
    """
    compact = args.arch == "compact"
    for name in IMAGES if compact else COMPACT:
        if getattr(args, name) not in (None, False):
            whose = "the paper's networks'" if compact else "compact's"
            raise TrainError(f"--{name} is {whose}, not {args.arch}'s")


def _parser() -> argparse.ArgumentParser:
    default, drives = TrainConfig(), DrivesConfig()
    paper, short = PRESETS["paper"], PRESETS["short"]
    parser = OneLineParser(
        prog="predictor.train",
        description="Train a network. Interrupted, it continues when the same command is given "
        "again.",
    )
    add = parser.add_argument
    add(
        "--arch",
        choices=("compact", *ARCHITECTURES),
        default="compact",
        help="architecture of the network (default: %(default)s)",
    )
    add(
        "--data",
        type=Path,
        metavar="DIR",
        help="folder of the training data. For compact: drives, "
        f"which are made first if they are missing (default: {drives.out}). For the paper's "
        "networks: frames of predictor.dataset or drives (default: data/simulated)",
    )
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of checkpoint, log, curve and weights "
        "(default: results/train, or results/networks/ARCH-EXPANSION)",
    )
    add(
        "--batch",
        type=between(1, 10**9),
        metavar="N",
        help=f"samples per optimiser step (default: {default.batch}; paper: "
        f"{paper.training.batch}; short: {short.training.batch})",
    )
    add(
        "--rate",
        type=between(1e-12, 1),
        metavar="R",
        help=f"highest learning rate (default: {default.rate:g};"
        f" paper: {paper.training.rate:g}; short: {short.training.rate:g})",
    )
    add(
        "--seed",
        type=between(0, 2**63),
        metavar="N",
        help=f"seed of the first weights and of the order of samples (default: {default.seed})",
    )
    parser.add_jobs()
    group = parser.add_argument_group("compact alone")
    add = group.add_argument
    add(
        "--train",
        type=between(1, 10**9),
        metavar="N",
        help=f"number of drives to train on (default: {drives.train})",
    )
    add(
        "--validation",
        type=between(1, 10**9),
        metavar="N",
        help=f"number of drives held out for validation (default: {drives.validation})",
    )
    add(
        "--steps",
        type=between(1, 10**9),
        metavar="N",
        help=f"number of optimiser steps (default: {default.steps})",
    )
    add(
        "--start",
        type=Path,
        metavar="FILE",
        help="weights to start from, such as "
        "predictor/compact.safetensors (default: random weights)",
    )
    add(
        "--logs",
        action="store_true",
        help="make the drives as logs of simulated robots, "
        "with the map of each log as truth, see predictor.drives",
    )
    add(
        "--families",
        nargs="+",
        choices=FAMILIES,
        metavar="F",
        help="families of the drives' "
        f"buildings, one drive each in turn (default: {' '.join(drives.families)})",
    )
    group = parser.add_argument_group("the paper's networks alone")
    group.add_argument(
        "--expansion",
        type=float,
        metavar="X",
        help="width of the predicted square "
        "divided by the 5 m of the crop; the paper has "
        f"{', '.join(map(str, EXPANSIONS))} (default: {EXPANSIONS[0]})",
    )
    add_arguments(group)
    return parser


if __name__ == "__main__":
    sys.exit(main())
