"""Train a network: the compact one, or one of the paper's.

    python -m predictor.train                      compact; about two hours on 2 cores, all in
    python -m predictor.train --steps 200 --train 20 --validation 4      a small run, end to end
    python -m predictor.train --start predictor/compact.safetensors --rate 5e-4      from weights on
    python -m predictor.train --arch unet_ff --expansion 1.3 --preset short
    torchrun --nproc-per-node 4 -m predictor.train --arch unet_ff --batch 16      on 4 GPUs

Interrupted, each goes on where it was when the same command is given again.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from predictor.data.drives_config import DrivesConfig
from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.mapping.families import FAMILIES
from predictor.networks import ARCHITECTURES
from predictor.networks.image_config import EXPANSIONS, PRESETS
from predictor.training.checkpoint import TrainError
from predictor.training.compact_training import TrainConfig
from predictor.training.image_arguments import NAMES, add_arguments, configured

if TYPE_CHECKING:
    import argparse

COMPACT = ("train", "validation", "steps", "start", "logs", "families")
"""Arguments that are compact's alone."""
IMAGES = ("expansion", *NAMES)
"""Arguments that are the paper's networks' alone."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("predictor.train", lambda: _run(_parser().parse_args(argv)))


def _run(args: argparse.Namespace) -> None:
    _check(args)
    path = _compact(args) if args.arch == "compact" else _images(args)
    # Of the processes that torchrun has started, one speaks.
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
    from predictor.data.drives_config import DrivesConfig
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
    # Not after hours of drives.
    out.mkdir(parents=True, exist_ok=True)
    make(DrivesConfig(data, count, tuned_on, logs=args.logs, families=families), args.jobs)
    # After the drives, whose processes must not wait for it.
    import torch

    from predictor.data.samples import Samples, check_apart

    torch.set_num_threads(args.jobs)
    train = Samples.load(data / "train", count)
    validation = Samples.load(data / "validation", tuned_on)
    check_apart({"train": train, "validation": validation})
    config = TrainConfig(
        args.steps or default.steps, args.batch or default.batch, args.rate or default.rate,
        seed=args.seed or default.seed, start=start and start[1]["fingerprint"],
    )  # fmt: skip
    return CompactTrainer(config, train, validation, out, start).run()


def _check(args: argparse.Namespace) -> None:
    """Refuse what makes no sense.

    Raises:
        TrainError: if something does not.
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
        description="Train a network. Interrupted, it goes on where it was: give the same command "
        "again.",
    )
    add = parser.add_argument
    add("--arch", choices=("compact", *ARCHITECTURES), default="compact",
        help="the network (default: %(default)s)")  # fmt: skip
    add("--data", type=Path, metavar="DIR", help=f"what it learns from: compact's drives, which "
        f"are made first where they are missing (default: {drives.out}), or the frames of "
        "predictor.dataset (default: data/simulated), or compact's drives likewise")  # fmt: skip
    add("--out", type=Path, metavar="DIR", help="checkpoint, log, curve and weights (default: "
        "results/train, or results/networks/ARCH-EXPANSION)")  # fmt: skip
    add(
        "--batch",
        type=between(1, 10**9),
        metavar="N",
        help=f"samples a step (default: {default.batch}; paper: "
        f"{paper.training.batch}; short: {short.training.batch})",
    )
    add(
        "--rate",
        type=between(1e-12, 1),
        metavar="R",
        help=f"highest learning rate (default: {default.rate:g};"
        f" paper: {paper.training.rate:g}; short: {short.training.rate:g})",
    )
    add("--seed", type=between(0, 2**63), metavar="N", help="of first weights and order of samples "
        f"(default: {default.seed})")  # fmt: skip
    parser.add_jobs()
    group = parser.add_argument_group("compact alone")
    add = group.add_argument
    add(
        "--train",
        type=between(1, 10**9),
        metavar="N",
        help=f"drives to learn from (default: {drives.train})",
    )
    add("--validation", type=between(1, 10**9), metavar="N",
        help=f"drives to measure on (default: {drives.validation})")  # fmt: skip
    add(
        "--steps",
        type=between(1, 10**9),
        metavar="N",
        help=f"of the optimiser (default: {default.steps})",
    )
    add("--start", type=Path, metavar="FILE", help="weights to go on from, such as the shipped "
        "ones: predictor/compact.safetensors (default: random ones)")  # fmt: skip
    add("--logs", action="store_true", help="--data is of simulated robots' logs, whose truth is "
        "what they map: see predictor.drives")  # fmt: skip
    add("--families", nargs="+", choices=FAMILIES, metavar="F", help="of the drives' buildings, in "
        f"turn (default: {' '.join(drives.families)})")  # fmt: skip
    group = parser.add_argument_group("the paper's networks alone")
    group.add_argument("--expansion", type=float, metavar="X", help="width of the predicted square "
        f"over that of the 5 m crop; the paper has {', '.join(map(str, EXPANSIONS))} (default: "
        f"{EXPANSIONS[0]})")  # fmt: skip
    add_arguments(group)
    return parser


if __name__ == "__main__":
    sys.exit(main())
