"""How good a network is on validation drives, while it is being trained."""

from __future__ import annotations

import numpy as np
import torch

from predictor.data.samples import Samples
from predictor.networks.compact_net import ROOM, CompactNet
from predictor.scoring.scores import RINGS, Scores
from predictor.training.targets import batch_of, known_of

VALIDATED = 1024
"""Samples of a validation."""


def validate(net: CompactNet, samples: Samples, side: int) -> Scores:
    """Scores of a network on VALIDATED samples spread evenly over a set.

    Args:
        net: the network, ready for inference.
        samples: of which the middles are taken.
        side: of the middles [cells].
    """
    scores = Scores()
    device = next(net.parameters()).device
    chosen = np.unique(np.linspace(0, len(samples) - 1, VALIDATED).astype(int))
    for start in range(0, len(chosen), 32):
        part = [samples[int(i)] for i in chosen[start : start + 32]]
        codes = batch_of(part, side, np.zeros(len(part), dtype=bool))
        with torch.inference_mode():
            logits = net(known_of(codes.to(device)))[:, :ROOM]
        p_free, p_occupied, _ = torch.softmax(logits.float(), dim=1).cpu().numpy().swapaxes(0, 1)
        truth, seen = codes.numpy() // 3, codes.numpy() % 3
        ring = np.where(seen == 2, np.int8(RINGS - 1), np.int8(-1))
        scores.add(p_free, p_occupied, truth == 0, truth == 1, ring)
    return scores
