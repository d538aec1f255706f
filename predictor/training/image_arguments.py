"""The arguments that decide a network of the paper and its training."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from predictor.networks.image_config import GIVEN, PRESETS, SIDES, ImageConfig, ImageTraining
from predictor.training.checkpoint import TrainError

NAMES = ("preset", "given", "width", "side", "epochs", "sigma", "bf16")
"""Those that `add_arguments` adds."""


def add_arguments(group: argparse._ActionsContainer) -> None:
    """Add them to a parser; what is not given is None, or False."""
    paper, short = PRESETS["paper"], PRESETS["short"]
    add = group.add_argument
    add("--preset", choices=tuple(PRESETS), help="a size and a schedule: paper, as printed, or "
        "short, for 2 CPU cores; what is given beside it differs from it, and is recorded with "
        "the weights (default: paper)")  # fmt: skip
    add("--given", choices=GIVEN, help="what the network sees: the 5 m crop alone, or all that was "
        "seen inside the predicted square (default: crop)")  # fmt: skip
    add("--width", type=float, metavar="F", help="factor of all channels (paper: "
        f"{paper.width:g}; short: {short.width:g})")  # fmt: skip
    add("--side", type=int, choices=SIDES, help=f"of the images [pixels] (paper: {paper.side}; "
        f"short: {short.side})")  # fmt: skip
    add("--epochs", type=float, metavar="E", help="times that each frame is learnt from (paper: "
        f"{paper.training.epochs:g}; short: {short.training.epochs:g})")  # fmt: skip
    add("--sigma", type=float, metavar="S", help="standard deviation of the first weights; the "
        f"paper prints 0.2 (default: {paper.training.sigma:g}, pix2pix's)")  # fmt: skip
    add("--bf16", action="store_true", help="bfloat16 where it may stand in for single precision")


def configured(
    args: argparse.Namespace, arch: str, expansion: float
) -> tuple[ImageConfig, ImageTraining]:
    """A network and its training: the preset, and what differs from it.

    Args:
        args: those of `add_arguments`, and `batch`, `rate` and `seed`; None: the preset's.
        arch: the network's name.
        expansion: of the crop.

    Raises:
        TrainError: if a value cannot be used.
    """
    base = PRESETS[args.preset or "paper"]
    training = _given(args, "epochs", "batch", "rate", "sigma", "seed")
    training |= {"brief": True} if args.bf16 else {}
    network = {"width": base.width, "side": base.side} | _given(args, "given", "width", "side")
    try:
        learns = dataclasses.replace(base.training, **training)
        # What batch normalisation is with a batch of one.
        over = "image" if learns.batch == 1 else "batch"
        return ImageConfig(arch, expansion, over=over, **network), learns
    except ValueError as error:
        raise TrainError(f"--{error}") from None


def _given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}
