"""The training of the far network on the coarse maps of samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.networks.far_net import FarNet
from predictor.scoring.scores import RINGS, Scores
from predictor.training.compact_targets import mirrored
from predictor.training.optimisation import deterministic
from predictor.training.samples_trainer import SamplesTrainer
from predictor.training.settings import SamplesTraining
from predictor.training.trainer import spread

VALIDATED = 1024
"""Number of samples of a validation."""


class FarTrainer(SamplesTrainer):
    """A training of the far network.

    Args:
        config: settings of the training.
        train: training samples.
        validation: validation samples.
        out: folder of checkpoint, log, curve and weights.
        start: network to start from, and the facts of its training; None: random weights.

    Raises:
        TrainError: if the folder holds another training, or the weights to start from have learned
            from buildings of the validation samples.
    """

    CURVES = (("loss", "nll"), ("iou_free", "auc_free"), ("ece_free", "brier_free"))

    def __init__(
        self,
        config: SamplesTraining,
        train: Samples,
        validation: Samples,
        out: Path,
        start: tuple[CompactNet, dict[str, Any]] | None = None,
    ) -> None:
        deterministic(config.seed)
        net, before = (FarNet(), {}) if start is None else start
        super().__init__(config, train, validation, out / "far.safetensors", net, before, {})

    def _batch(self, step: int) -> tuple[Any, ...]:
        rng = np.random.default_rng([self.config.seed, step])
        chosen = rng.integers(len(self.train), size=self.config.batch)
        mirror, turns = rng.random(len(chosen)) < 0.5, int(rng.integers(4))
        return self._data(chosen), torch.from_numpy(mirror), turns

    def _loss(self, codes: Tensor, coarse: Tensor, mirror: Tensor, turns: int) -> Tensor:
        # The heading says where the robot has been, but not what the building is like.
        coarse = torch.rot90(mirrored(coarse, mirror), turns, dims=(2, 3))
        known, free, asked = targets(coarse)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.brief):
            logits = self.net(known)[:, 0]
        of_cells = F.binary_cross_entropy_with_logits(logits.float(), free, reduction="none")
        return (of_cells * asked).sum() / asked.sum().clamp(min=1)

    def _measures(self) -> dict[str, float]:
        return far_scores(self.smoothed(), self.validation).measures()


def targets(coarse: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return the input of the far network, its targets, and which cells it is asked about.

    Args:
        coarse: coarse maps of samples, (B, 3, FINER, FINER).

    Returns:
        1 where a cell was observed free as a whole, and 1 where a part of it was observed occupied,
        (B, 2, FINER, FINER); 1 where it is truly free as a whole; and 1 where neither was observed,
        (B, FINER, FINER) each.
    """
    known = torch.stack([coarse[:, 0] == 100, coarse[:, 1] > 0], dim=1).float()
    asked = 1.0 - known.amax(dim=1)
    return (
        known.contiguous(memory_format=torch.channels_last),
        (coarse[:, 2] == 100).float(),
        asked,
    )


def far_scores(net: CompactNet, samples: Samples) -> Scores:
    """Score the far network on `VALIDATED` samples; all that is not free counts as occupied.

    Args:
        net: network, ready for inference.
        samples: set of samples.
    """
    scores = Scores()
    device = next(net.parameters()).device
    chosen = spread(len(samples), VALIDATED)
    for start in range(0, len(chosen), 32):
        data = torch.from_numpy(samples.stacked(chosen[start : start + 32], 100)).to(device)
        known, free, asked = targets(Samples.parts(data)[1])
        with torch.inference_mode():
            p_free: NDArray[np.float32] = torch.sigmoid(net(known)[:, 0].float()).cpu().numpy()
        truly = free.cpu().numpy() > 0
        ring = np.where(asked.cpu().numpy() > 0, np.int8(RINGS - 1), np.int8(-1))
        scores.add(p_free, np.float32(1.0) - p_free, truly, ~truly, ring)
    return scores
