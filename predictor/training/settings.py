"""Settings of trainings: those that decide the resulting weights.

This module imports nothing heavy, since command lines are built from it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from foresee.infra.options import Options, option
from predictor.networks.image_config import ImageConfig


@dataclass(frozen=True)
class CompactTraining:
    """Settings of a training of the compact network.

    Attributes:
        steps: number of optimiser steps.
        batch: samples per step with squares of the side `compact_training.USUAL_SIDE`: a step with
            larger squares has fewer samples, one with smaller squares more.
        rate: highest learning rate.
        warmup: number of steps in which the learning rate rises to `rate`; then it falls along a
            cosine to zero.
        decay: weight decay of AdamW.
        average: share that the old average keeps in each step when weights are averaged over the
            steps.
        seed: seed of the first weights and of the order of samples.
        start: fingerprint of the weights that training starts from; None: random weights.
        context: channels of the context's network; 0: no context. If the weights to start from have
            no context, one is added.
    """

    steps: int = 8_000
    batch: int = 32
    rate: float = 2e-3
    warmup: int = 300
    decay: float = 0.02
    average: float = 0.998
    seed: int = 0
    start: str | None = None
    context: int = 24


TUNING = CompactTraining(steps=600, rate=5e-4, warmup=50, average=0.99)
"""Settings of a fine-tuning, by default: minutes on 2 cores."""
TUNING_DRIVES = (240, 60)
"""Number of drives to fine-tune on, and number held out for validation, by default."""


@dataclass(frozen=True)
class FrontierTraining(Options):
    """Settings of a training of the network of frontiers, with their options.

    Attributes:
        batch: samples of a step.
        rate: highest learning rate; it falls along a cosine to zero.
        decay: weight decay of AdamW.
    """

    steps: int = option(3_000, "number of optimiser steps", "N", low=1, high=10**9)
    batch: int = 256
    rate: float = 1e-3
    decay: float = 0.02
    seed: int = option(
        0, "seed of the first weights and of the order of samples", "N", low=0, high=2**63
    )


@dataclass(frozen=True)
class ImageTraining:
    """Settings of the training of a network of the paper.

    Attributes:
        epochs: number of passes over the frames; need not be whole.
        batch: frames per step.
        rate: learning rate of Adam; it falls linearly to zero over the second half.
        sigma: standard deviation of the first weights.
        dropout: dropout rate, in the layers that have one.
        brief: whether to compute in bfloat16 where torch's autocast allows it.
        seed: seed of the first weights, of the order of frames and of dropout.
    """

    epochs: float = 200.0
    batch: int = 1
    rate: float = 2e-4
    sigma: float = 0.02
    dropout: float = 0.5
    brief: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (("epochs", 0.0, 1e6), ("rate", 0.0, 1.0), ("sigma", 0.0, 10.0)):
            if not low < getattr(self, name) <= high:
                raise ValueError(
                    f"{name} is {getattr(self, name)}, it must lie in ({low:g}, {high:g}]"
                )
        if not 0.0 <= self.dropout < 1.0:
            raise ValueError(f"dropout is {self.dropout}, it must lie in [0, 1)")
        for name, least in (("batch", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, it must be at least {least}")


@dataclass(frozen=True)
class Preset:
    """Size and schedule, the same for all architectures.

    Attributes:
        width: see `ImageConfig`.
        side: see `ImageConfig` [pixels].
        training: settings of the training.
    """

    width: float
    side: int
    training: ImageTraining


PRESETS = {
    "paper": Preset(1.0, 256, ImageTraining(sigma=0.2)),
    "short": Preset(0.125, 128, ImageTraining(epochs=4.0, batch=8, rate=1e-3)),
}
"""`paper` is that of Katyal et al. 2018. `short` is for 2 CPU cores, which train all 20 networks in
two or three hours; its first weights are those of pix2pix."""


def described(
    config: ImageConfig, training: ImageTraining, digests: tuple[str, str]
) -> dict[str, Any]:
    """Return the facts that identify a training in checkpoints and weights.

    Args:
        config: settings of the network.
        training: settings of the training.
        digests: digests of the training frames and of the validation frames.
    """
    settings = asdict(training)
    # The first trainings did not record it, and go on as the same trainings.
    if training.dropout == ImageTraining.dropout:
        del settings["dropout"]
    return {"config": settings, "network": asdict(config), "data": list(digests)}
