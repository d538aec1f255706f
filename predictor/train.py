"""Train a network: `compact`, or one of the paper's.

    python -m predictor.train                      compact, and its drives: two hours on 2 cores
    python -m predictor.train --steps 200 --train 20 --validation 4      a quick trial
    python -m predictor.train --start predictor/compact.safetensors --world my_maps/
                                                   fine-tuning on your own buildings
    python -m predictor.train --arch unet_ff --expansion 1.3 --preset short
    torchrun --nproc-per-node 4 -m predictor.train --arch unet_ff --batch 16      on 4 GPUs

The same command resumes a training that was interrupted. compact is trained by
`predictor.training.compact_training` on samples of simulated drives, which
`predictor.recording.training_drives` makes first. `predictor.recording.own_buildings` reads the
maps and logs of --world and splits them into training and validation. The paper's networks are
trained by `predictor.training.image_training`.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foresee.infra.command_line import OneLineParser, between, run_command
from predictor.data import SIMULATED
from predictor.networks import ARCHITECTURES
from predictor.networks.image_config import EXPANSIONS, PRESETS
from predictor.recording.settings import DrivesConfig
from predictor.training.checkpoint import TrainError
from predictor.training.compact_config import TUNING, TUNING_DRIVES, CompactTraining
from predictor.training.image_arguments import NAMES, add_arguments, configured

if TYPE_CHECKING:
    from predictor.data.samples import Samples
    from predictor.networks.compact_net import CompactNet

Start = tuple["CompactNet", dict[str, Any]]
"""A network to start from, and the facts of its training."""
TRAINED = Path("results/train")
"""Default folder of the results of a training from random weights."""
TUNED = Path("data/fine-tuning"), Path("results/fine-tuning")
"""Default folders of the samples and of the results of a fine-tuning (--start)."""
RECORDED = ("simulated_logs", "families", "world", "share")
"""Fields of `DrivesConfig` that are also options of this command."""
COMPACT = ("train", "validation", "steps", "start", *RECORDED)
"""Options that are valid for compact alone."""
IMAGES = ("expansion", *NAMES)
"""Options that are valid for the paper's networks alone."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 2 for bad arguments or input, 130 if interrupted."""
    return run_command("predictor.train", lambda: _run(argv))


def _run(argv: list[str] | None) -> None:
    parser = _parser()
    args = parser.parse_args(argv)
    _check(args, parser)
    path = _compact(args) if args.arch == "compact" else _images(args)
    # Only the first process of torchrun prints.
    if os.environ.get("RANK", "0") == "0":
        print(path)


def _images(args: argparse.Namespace) -> Path:
    from predictor.training.image_training import train_images

    expansion = EXPANSIONS[0] if args.expansion is None else args.expansion
    config, training = configured(args, args.arch, expansion)
    out = args.out or Path("results/networks") / f"{args.arch}-{expansion:g}"
    return train_images(config, training, args.data or SIMULATED, out, args.jobs)


def _compact(args: argparse.Namespace) -> Path:
    """Train compact, on drives that are made first if they are missing."""
    import torch

    from predictor.recording.training_drives import make
    from predictor.training.compact_comparison import table
    from predictor.training.compact_training import CompactTrainer

    recorded = DrivesConfig.of(args, *RECORDED)
    start = None if args.start is None else _start_of(args.start)
    drives = _drives_of(args, recorded)
    # Made now, so that an unusable folder is reported before hours of drives.
    out = _made_folder(args)
    make(drives, args.jobs, frozenset(start[1].get("worlds", ())) if start else frozenset())
    torch.set_num_threads(args.jobs)
    train, validation = _samples_of(drives)
    path = CompactTrainer(_config_of(args, start), train, validation, out, start).run()
    if start is not None:
        print(table(args.start, path, validation))
    return path


def _start_of(path: Path) -> Start:
    """Read the weights to start from.

    Raises:
        TrainError: if the file does not hold weights of compact.
    """
    from predictor.networks.compact_net import CompactNet
    from predictor.weights import WeightsError, load_weights

    try:
        return load_weights(path, CompactNet)
    except WeightsError as error:
        raise TrainError(f"--start: {error}") from None


def _drives_of(args: argparse.Namespace, recorded: DrivesConfig) -> DrivesConfig:
    """Return the settings of the drives: folder and numbers as given, or else the defaults.

    Args:
        args: arguments of the command.
        recorded: settings with the options of `RECORDED`, and defaults of a training from scratch.
    """
    out, train, validation = recorded.out, recorded.train, recorded.validation
    if args.start is not None:
        out, (train, validation) = TUNED[0], TUNING_DRIVES
    return replace(
        recorded,
        out=args.data or out,
        train=args.train or train,
        validation=args.validation or validation,
    )


def _made_folder(args: argparse.Namespace) -> Path:
    """Make the folder of the results, and return its path.

    Raises:
        TrainError: if the new weights would overwrite those that training starts from.
    """
    out: Path = args.out or (TRAINED if args.start is None else TUNED[1])
    if args.start is not None and (out / "compact.safetensors").resolve() == args.start.resolve():
        raise TrainError(f"--out {out} would overwrite the weights of --start: choose another")
    out.mkdir(parents=True, exist_ok=True)
    return out


def _samples_of(drives: DrivesConfig) -> tuple[Samples, Samples]:
    """Read the samples to train on, and those to validate on.

    Raises:
        SamplesError: if they cannot be read.
        SplitError: if they share a building.
    """
    from predictor.data.samples import Samples
    from predictor.data.splits import check_apart

    train = Samples.load(drives.out / "train", drives.train)
    validation = Samples.load(drives.out / "validation", drives.validation)
    check_apart({"train": train.worlds, "validation": validation.worlds})
    return train, validation


def _config_of(args: argparse.Namespace, start: Start | None) -> CompactTraining:
    """Return the settings of the training: as given, or else the defaults.

    Args:
        args: arguments of the command.
        start: what the training starts from; None: random weights.
    """
    default = CompactTraining() if start is None else TUNING
    return replace(
        default,
        steps=args.steps or default.steps,
        batch=args.batch or default.batch,
        rate=args.rate or default.rate,
        seed=args.seed or default.seed,
        start=None if start is None else start[1]["fingerprint"],
    )


def _check(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Refuse options that do not belong to the architecture that is trained.

    Raises:
        TrainError: if there is one.
    """
    compact = args.arch == "compact"
    for name in IMAGES if compact else COMPACT:
        if getattr(args, name) != parser.get_default(name):
            whose = "the paper's networks'" if compact else "compact's"
            raise TrainError(f"--{name.replace('_', '-')} is {whose}, not {args.arch}'s")


def _parser() -> argparse.ArgumentParser:
    default, drives = CompactTraining(), DrivesConfig()
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
        f"which are made first if they are missing (default: {drives.out}; with --start: "
        f"{TUNED[0]}). For the paper's networks: frames of predictor.dataset or drives "
        f"(default: {SIMULATED})",
    )
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of checkpoint, log, curve and weights "
        f"(default: {TRAINED}; with --start: {TUNED[1]}; or results/networks/ARCH-EXPANSION)",
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
        help=f"highest learning rate (default: {default.rate:g}; with --start: {TUNING.rate:g};"
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
        type=between(1, 10**6),
        metavar="N",
        help="number of drives to train on, with about 50 samples each "
        f"(default: {drives.train}; with --start: {TUNING_DRIVES[0]})",
    )
    add(
        "--validation",
        type=between(1, 10**6),
        metavar="N",
        help="number of drives held out for validation "
        f"(default: {drives.validation}; with --start: {TUNING_DRIVES[1]})",
    )
    add(
        "--steps",
        type=between(1, 10**9),
        metavar="N",
        help=f"number of optimiser steps (default: {default.steps}; with --start: {TUNING.steps})",
    )
    add(
        "--start",
        type=Path,
        metavar="FILE",
        help="weights to fine-tune, such as predictor/compact.safetensors (default: random "
        "weights). The scores before and after are printed at the end",
    )
    DrivesConfig.add_to(group, *RECORDED)
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
