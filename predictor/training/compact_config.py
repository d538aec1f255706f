"""Settings of a training of the compact network, in a module that is quick to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CompactTraining:
    """Settings that decide the weights that a training of the compact network results in.

    Attributes:
        steps: number of optimiser steps.
        batch: samples per step for squares of the usual side (`compact_training.USUAL`); a step
            with larger squares has fewer samples, one with smaller squares more.
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
