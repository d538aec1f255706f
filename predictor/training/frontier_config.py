"""Settings of a training of the network of frontiers, in a module that is quick to import."""

from __future__ import annotations

from dataclasses import dataclass

from foresee.infra.options import Options, option


@dataclass(frozen=True)
class FrontierTraining(Options):
    """Settings that decide the weights that a training results in, with their options.

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
