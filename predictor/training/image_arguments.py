"""Command-line arguments of the paper's networks and their training."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from predictor.networks.image_config import GIVEN, SIDES, ImageConfig
from predictor.training.checkpoint import TrainError
from predictor.training.settings import PRESETS, ImageTraining

NAMES = ("preset", "given", "width", "side", "epochs", "sigma", "bf16")
"""Arguments that `add_arguments` adds."""


def add_arguments(group: argparse._ActionsContainer) -> None:
    """Add the arguments to a parser or group; an argument that is not given is None or False."""
    paper, short = PRESETS["paper"], PRESETS["short"]
    told = {
        "preset": "size and schedule: that of the paper, or short, for 2 CPU cores; the other "
        "options change single values (default: paper)",
        "given": "what the network is given: the 5 m crop alone, or all that was observed inside "
        "the predicted square (default: crop)",
        "width": "factor of the number of channels "
        f"(paper: {paper.width:g}; short: {short.width:g})",
        "side": f"side of the images [pixels] (paper: {paper.side}; short: {short.side})",
        "epochs": "number of passes over the frames "
        f"(paper: {paper.training.epochs:g}; short: {short.training.epochs:g})",
        "sigma": "standard deviation of the initial weights; the paper states 0.2 "
        f"(default: {paper.training.sigma:g}, as in pix2pix)",
        "bf16": "compute in bfloat16 where torch's autocast allows it",
    }
    add = group.add_argument
    add("--preset", choices=tuple(PRESETS), help=told["preset"])
    add("--given", choices=GIVEN, help=told["given"])
    add("--width", type=float, metavar="F", help=told["width"])
    add("--side", type=int, choices=SIDES, help=told["side"])
    add("--epochs", type=float, metavar="E", help=told["epochs"])
    add("--sigma", type=float, metavar="S", help=told["sigma"])
    add("--bf16", action="store_true", help=told["bf16"])


def configured(
    args: argparse.Namespace, arch: str, expansion: float
) -> tuple[ImageConfig, ImageTraining]:
    """Return the settings of a network and of its training: the preset with the given values.

    Args:
        args: arguments of `add_arguments`, and `batch`, `rate` and `seed`; for None the preset's
            value is used.
        arch: name of the architecture.
        expansion: width of the predicted square divided by that of the crop.

    Raises:
        TrainError: if a value cannot be used.
    """
    base = PRESETS[args.preset or "paper"]
    training = _given(args, "epochs", "batch", "rate", "sigma", "seed")
    training |= {"brief": True} if args.bf16 else {}
    network = {"width": base.width, "side": base.side} | _given(args, "given", "width", "side")
    try:
        learns = dataclasses.replace(base.training, **training)
        # With a batch of one, batch normalisation normalises over the image.
        over = "image" if learns.batch == 1 else "batch"
        return ImageConfig(arch, expansion, over=over, **network), learns
    except ValueError as error:
        raise TrainError(f"--{error}") from None


def _given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}
