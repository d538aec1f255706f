"""The settings of a training of the compact network, apart from what takes long to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainConfig:
    """Settings that decide the numbers of a training.

    Attributes:
        steps: number of optimiser steps.
        batch: samples per step at `USUAL` side; fewer of a larger side, more of a smaller.
        rate: highest learning rate.
        warmup: steps in which the rate rises to it; then it falls along a cosine to zero.
        decay: weight decay of AdamW.
        average: share that the old average keeps when weights are averaged over the steps.
        seed: seed of the first weights and of the order of samples.
        start: fingerprint of the weights that training starts from; None: random weights.
        context: channels of the network of the context; weights to start from that have none get
            one. 0: none.
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


TUNING = TrainConfig(steps=600, rate=5e-4, warmup=50, average=0.99)
"""Settings of a fine-tuning, by default: minutes on 2 cores."""
TUNING_DRIVES = (240, 60)
"""Number of drives to fine-tune on, and number held out for validation, by default."""
