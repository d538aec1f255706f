"""The training of the network of frontiers on samples of explorations."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from foresee.infra.markdown import records
from predictor.data.frontier_samples import COLUMNS, GOALS, FrontierSamples, way_back
from predictor.networks.frontier_net import SCALE, FrontierNet
from predictor.runtime import fastest_device
from predictor.training.optimisation import cosine, descend, deterministic
from predictor.training.settings import FrontierTraining
from predictor.training.trainer import Trainer, common_facts
from predictor.weights import save_weights

VALIDATION_BATCH = 512
"""Number of samples of a batch of the validation."""


class FrontierTrainer(Trainer):
    """A training of the network of frontiers.

    Args:
        config: settings of the training.
        train: training samples.
        validation: validation samples.
        out: folder of checkpoint, log, curve and weights.

    Raises:
        TrainError: if the folder holds another training.
    """

    LOSSES = ("loss", "of_leads")
    CURVES = (("loss",), ("of_leads", "validation_of_leads"), ("validation_of_ways",))

    def __init__(
        self,
        config: FrontierTraining,
        train: FrontierSamples,
        validation: FrontierSamples,
        out: Path,
    ) -> None:
        self.config, self.train, self.validation = config, train, validation
        self.device = fastest_device()
        deterministic(config.seed)
        self.net = FrontierNet().to(self.device)
        self.optimizer = torch.optim.AdamW(
            self.net.parameters(), config.rate, weight_decay=config.decay
        )
        self.parts = {"net": self.net, "optimizer": self.optimizer}
        facts = common_facts(config, self.net, self.device, train, validation)
        facts |= {"buildings": len(train.about)}
        note_every = max(1, min(500, config.steps // 6))
        super().__init__(
            out / "frontiers.safetensors", facts, config.steps, note_every, self.device
        )

    def _batch(self, step: int) -> tuple[Tensor, ...]:
        rng = np.random.default_rng([self.config.seed, step])
        chosen = rng.integers(len(self.train), size=self.config.batch)
        goals = rng.integers(GOALS, size=len(chosen))
        pictures, numbers = _read(self.train, chosen, goals)
        for kind, (picture, row) in zip(
            rng.integers(8, size=len(chosen)), zip(pictures, numbers, strict=True), strict=True
        ):
            picture[:], row[:2] = _turned(picture, row[:2], int(kind))
        return (
            torch.from_numpy(pictures),
            torch.from_numpy(numbers),
            torch.from_numpy(self.train.sizes[chosen]),
        )

    def _learn(self, *batch: Tensor) -> list[float]:
        self.net.train()
        of_leads, of_ways = _losses(self.net, *(part.to(self.device) for part in batch))
        loss = of_leads.mean() + of_ways.mean()
        rate = self.config.rate * cosine(self.step, self.config.steps)
        descend(self.optimizer, loss, rate, self.net)
        return [float(loss.detach()), float(of_leads.detach().mean())]

    def _measures(self) -> dict[str, float]:
        of_leads, of_ways = frontier_losses(self.net, self.validation)
        return {
            "validation_of_leads": float(of_leads.mean()),
            "validation_of_ways": float(of_ways.mean()),
        }

    def _export(self, facts: dict[str, Any]) -> None:
        save_weights(self.weights, self.net, facts | {"validation": self.log[-1]})


def frontier_losses(
    net: FrontierNet, samples: FrontierSamples
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the losses of `leads` and of both ways, for the goals of the drives, (n,) each."""
    net.eval()
    device = next(net.parameters()).device
    parts = []
    with torch.inference_mode():
        for start in range(0, len(samples), VALIDATION_BATCH):
            chosen = np.arange(start, min(start + VALIDATION_BATCH, len(samples)))
            pictures, numbers = _read(samples, chosen, np.zeros(len(chosen), dtype=int))
            batch = (pictures, numbers, samples.sizes[chosen])
            losses = _losses(net, *(torch.from_numpy(part).to(device) for part in batch))
            parts.append(torch.stack(losses).cpu().numpy())
    of_leads, of_ways = np.concatenate(parts, axis=1)
    return of_leads, of_ways


def scores(net: FrontierNet, samples: FrontierSamples) -> str:
    """Return a table of the log-loss of `leads` in each family, and of the best constant there."""
    of_leads, _ = frontier_losses(net, samples)
    leads = samples.numbers[:, 0, COLUMNS.index("leads")]
    families = np.array(samples.families)[samples.family_numbers]
    rows = []
    for family in (*sorted(set(families)), "all"):
        here = (families == family) | (family == "all")
        share = float(leads[here].mean())
        constant = -sum(p * math.log(p) for p in (share, 1.0 - share) if p > 0.0)
        rows.append(
            {
                "family": str(family),
                "frontiers": int(here.sum()),
                "lead to the goal": f"{share:.3f}",
                "log-loss": f"{of_leads[here].mean():.3f}",
                "of the best constant": f"{constant:.3f}",
            }
        )
    return records(rows)


def _read(
    samples: FrontierSamples, chosen: NDArray[np.intp], goals: NDArray[np.intp]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the pictures of samples (n, 3, SIDE, SIDE), and their numbers for a goal each."""
    pictures = np.stack([samples.picture(int(i)) for i in chosen])
    return pictures, samples.numbers[chosen, goals].copy()


def _turned(
    picture: NDArray[np.uint8], goal: NDArray[np.float32], kind: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return a picture and its goal under one of the eight symmetries of a square."""
    x, y = goal
    if kind & 1:
        picture, x = picture[:, :, ::-1], -x
    if kind & 2:
        picture, y = picture[:, ::-1], -y
    if kind & 4:
        picture, (x, y) = picture.transpose(0, 2, 1), (y, x)
    # A copy: the result is written into the array that the argument is a view of.
    return picture.copy(), np.array([x, y], dtype=np.float32)


def _losses(
    net: FrontierNet, pictures: Tensor, numbers: Tensor, sizes: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the losses of `leads` and of both ways, (B,) each."""
    dx, dy, to_go, leads, way, beyond = numbers.unbind(dim=1)
    goals, back = torch.stack([dx, dy], dim=1), way_back(beyond)
    logit, predicted_way, predicted_back = net(pictures.float() / 100.0, goals, to_go, sizes)
    of_leads = F.binary_cross_entropy_with_logits(logit, leads, reduction="none")
    of_way = leads * F.smooth_l1_loss(predicted_way / SCALE, way / SCALE, reduction="none")
    of_back = (1 - leads) * F.smooth_l1_loss(predicted_back / SCALE, back / SCALE, reduction="none")
    return of_leads, 0.5 * (of_way + of_back)
