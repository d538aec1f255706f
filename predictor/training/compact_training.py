"""The training of the compact network on samples of drives; the exported weights are averages."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from predictor.data.samples import Samples
from predictor.data.squares import NOTHING, parted
from predictor.networks.compact_net import ROOM, CompactNet, ContextNet
from predictor.networks.quantised_conv import input_ranges
from predictor.runtime import fastest_device
from predictor.scoring.scores import RINGS, Scores
from predictor.training.checkpoint import TrainError
from predictor.training.compact_targets import (
    NEAR,
    contexts,
    known_input,
    losses,
    middle_squares,
)
from predictor.training.optimisation import cosine, descend, deterministic
from predictor.training.settings import CompactTraining
from predictor.training.trainer import Trainer, common_facts, spread
from predictor.weights import save_weights

SQUARE_SIDES = (200, 200, 200, 120, 160, 240, 280)
"""Sides of the squares of a step, drawn at random [cells], since windows and expansions of drives
differ."""
USUAL_SIDE = 200
"""Side of the square at a window of 5 m and an expansion of 2 [cells]."""
ALONE = 0.2
"""Share of the samples that are used without their context, since the predictor may be called
without one."""
HELD = 0.5
"""Largest share of a GPU's free memory that the samples may fill."""
VALIDATED = 1024
"""Number of samples of a validation."""
RANGED = 256
"""Number of samples from which the ranges of a quantised network are measured."""
KIND_WEIGHT = 0.05
"""Weight of the loss of `KindOfBuilding`."""


class CompactTrainer(Trainer):
    """A training of the compact network.

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

    CURVES = (("loss", "nll"), ("iou_free", "iou_occupied", "auc_free"), ("ece_free", "brier_free"))

    def __init__(
        self,
        config: CompactTraining,
        train: Samples,
        validation: Samples,
        out: Path,
        start: tuple[CompactNet, dict[str, Any]] | None = None,
    ) -> None:
        self.config, self.train, self.validation = config, train, validation
        self.device = fastest_device()
        # PyTorch tells the instructions of a processor from 2.11 on.
        of_processor: dict[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
        self.brief = self.device.type == "cuda" or bool(of_processor.get("avx512_bf16"))
        deterministic(config.seed)
        net, before = (CompactNet(), {}) if start is None else start
        check_unlearned(before, validation)
        if net.kinds is not None:
            print(
                "The layer of kinds of --start is left out, since its features change; "
                "--arch kinds fits a new one."
            )
        # Both were fitted to features that change now. The layer has to be fitted again afterwards.
        net = net.with_context(config.context).without_kinds_and_ranges()
        self.net = net.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.kinds = None
        if net.context is not None:
            self.kinds = KindOfBuilding(net.context, len(train.families)).to(self.device)
        self.averaged = {name: v.detach().clone() for name, v in self.net.state_dict().items()}
        learned = [*self.net.parameters(), *(self.kinds.parameters() if self.kinds else ())]
        self.optimizer = torch.optim.AdamW(
            learned, config.rate, (0.9, 0.98), weight_decay=config.decay
        )
        self.parts = {"net": self.net, "optimizer": self.optimizer}
        facts = common_facts(config, self.net, self.device, train, validation) | {
            "bfloat16": self.brief,
            "before": {
                name: before[name]
                for name in ("fingerprint", "config", "drives", "samples", "commit", "before")
                if name in before
            },
            "drives": len(train.about),
            "losses": {"near": NEAR, "kind": KIND_WEIGHT},
        }
        for name in ("worlds", "validation_worlds"):
            facts[name] = sorted({*facts[name], *before.get(name, ())})
        # A GPU is faster than what unpacks the samples, so it holds them all if it can.
        self.held: Tensor | None = None
        held = train.SIZE * len(train)
        if self.device.type == "cuda" and held < HELD * torch.cuda.mem_get_info(self.device)[0]:
            self.held = self._unpacked(np.arange(len(train))).to(self.device)
        note_every = max(1, min(500, config.steps // 10))
        super().__init__(out / "compact.safetensors", facts, config.steps, note_every, self.device)

    def smoothed(self) -> CompactNet:
        """Return the network with averaged weights, which is validated and exported."""
        net = type(self.net)(self.net.config)
        net.load_state_dict(self.averaged)
        return net.to(self.device, memory_format=torch.channels_last).eval()

    def _state(self) -> dict[str, Any]:
        kinds = self.kinds and self.kinds.state_dict()
        return super()._state() | {"kinds": kinds, "averaged": self.averaged}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        if self.kinds is not None:
            self.kinds.load_state_dict(state["kinds"])
        self.averaged = state["averaged"]

    def _data(self, chosen: NDArray[np.int64]) -> Tensor:
        """Return the bytes of some training samples; their numbers, if they are held already."""
        if self.held is None:
            return self._unpacked(chosen)
        return torch.from_numpy(chosen)

    def _unpacked(self, chosen: NDArray[np.int64]) -> Tensor:
        return torch.from_numpy(self.train.stacked(chosen, 100))

    def _batch(self, step: int) -> tuple[Any, ...]:
        rng = np.random.default_rng([self.config.seed, step])
        side = int(rng.choice(SQUARE_SIDES))
        count = max(1, round(self.config.batch * (USUAL_SIDE / side) ** 2))
        chosen = rng.integers(len(self.train), size=count)
        mirror, alone = rng.random(count) < 0.5, rng.random(count) < ALONE
        families = self.train.family_numbers[chosen]
        return (
            self._data(chosen),
            side,
            *(torch.from_numpy(part) for part in (mirror, alone, families)),
        )

    def _learn(self, *batch: Any) -> list[float]:
        config, step = self.config, self.step
        self.net.train()
        data, side, *options = batch
        data = data.to(self.device)
        codes, coarse = Samples.parts(data if self.held is None else self.held[data])
        loss = self._loss(codes, coarse, side, *(option.to(self.device) for option in options))
        rate = config.rate * min(1.0, (step + 1) / config.warmup) * cosine(step, config.steps)
        descend(self.optimizer, loss, rate, self.net)
        # The average follows fast at first, so that it forgets the first weights.
        keep = min(config.average, step / (step + 10.0))
        with torch.no_grad():
            for name, values in self.net.state_dict().items():
                if values.dtype.is_floating_point:
                    self.averaged[name].lerp_(values, 1.0 - keep)
                else:
                    self.averaged[name].copy_(values)
        return [float(loss.detach())]

    def _loss(
        self,
        codes: Tensor,
        coarse: Tensor,
        side: int,
        mirror: Tensor,
        alone: Tensor,
        families: Tensor,
    ) -> Tensor:
        """Return the loss of a batch.

        Args:
            codes: codes of the samples, (B, SIDE, SIDE).
            coarse: their contexts, (B, 2, CELLS, CELLS).
            side: side of the squares to learn from [cells].
            mirror: which samples to mirror across the heading, (B,).
            alone: which samples have no context, (B,).
            families: number of each sample's family, (B,).
        """
        codes = middle_squares(codes, side, mirror)
        context = contexts(coarse, mirror, alone, side)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.brief):
            logits = self.net(known_input(codes), context)
        loss = torch.stack(losses(logits.float(), codes)).sum()
        if self.kinds is not None:
            loss = loss + KIND_WEIGHT * self.kinds.loss(families, codes)
        return loss

    def _export(self, facts: dict[str, Any]) -> None:
        net = quantised(self.smoothed(), self.train)
        save_weights(self.weights, net, facts | {"validation": self.log[-1]})

    def _measures(self) -> dict[str, float]:
        return validate(self.smoothed(), self.validation, USUAL_SIDE).measures()


def check_unlearned(before: dict[str, Any], validation: Samples) -> None:
    """Check that weights to start from have not learned from the buildings to validate on.

    Args:
        before: facts of the training of these weights; empty: random weights.
        validation: validation samples.

    Raises:
        TrainError: if they have.
    """
    both = validation.worlds & set(before.get("worlds", ()))
    if both:
        raise TrainError(
            f"--start: its weights have learned from {len(both)} of the buildings to validate on"
        )


def quantised(net: CompactNet, samples: Samples) -> CompactNet:
    """Return a copy that computes in 8-bit integers, for the ranges of `RANGED` of some samples."""
    net.eval()
    chosen = spread(len(samples), RANGED)
    run = partial(validate, net, samples, USUAL_SIDE, chosen)
    return net.with_ranges(input_ranges(net.convolutions(), run))


class KindOfBuilding(nn.Module):
    """Auxiliary tasks of the context's network: the family of the building, and the share of free.

    The kind of building changes the prediction of few cells, so that the loss of the cells alone
    would hardly teach the network to recognise it. The tasks are used in training only.

    Args:
        context: network of the context, whose summary is read by a forward hook.
        families: number of families of buildings.
    """

    def __init__(self, context: ContextNet, families: int) -> None:
        super().__init__()
        self.families = families
        self.head = nn.Linear(2 * context.coarse.first.conv.out_channels, families + 1)
        context.register_forward_hook(self._catch)

    def _catch(self, context: nn.Module, given: Any, found: tuple[Tensor, Tensor]) -> None:
        if context.training:
            self.summary = found[1]

    def loss(self, families: Tensor, codes: Tensor) -> Tensor:
        """Compute the sum of the cross-entropies of both tasks for the network's last batch.

        Args:
            families: number of each sample's family, (B,).
            codes: codes of the samples, (B, H, W).
        """
        logits = self.head(self.summary.float())
        seen, truth = parted(codes)
        unseen = seen == NOTHING
        free = (unseen & (truth == 0)).sum(dim=(1, 2)) / unseen.sum(dim=(1, 2)).clamp(min=1)
        of_free = F.binary_cross_entropy_with_logits(logits[:, -1], free.float())
        return F.cross_entropy(logits[:, :-1], families) + of_free


def validate(
    net: CompactNet, samples: Samples, side: int, chosen: NDArray[np.intp] | None = None
) -> Scores:
    """Score the compact network on samples.

    Args:
        net: network, ready for inference.
        samples: set of samples.
        side: side of the square in their middle that is scored [cells].
        chosen: numbers of the samples; None: `VALIDATED` of them, spread evenly over the set.
    """
    scores = Scores()
    device = next(net.parameters()).device
    if chosen is None:
        chosen = spread(len(samples), VALIDATED)
    for start in range(0, len(chosen), 32):
        data = torch.from_numpy(samples.stacked(chosen[start : start + 32], 100)).to(device)
        squares, coarse = Samples.parts(data)
        none = torch.zeros(len(data), dtype=torch.bool, device=device)
        codes = middle_squares(squares, side, none)
        with torch.inference_mode():
            logits = net(known_input(codes), contexts(coarse, none, none, side))[:, :ROOM]
        p_free, p_occupied, _ = torch.softmax(logits.float(), dim=1).cpu().numpy().swapaxes(0, 1)
        seen, truth = parted(codes.cpu().numpy())
        ring = np.where(seen == NOTHING, np.int8(RINGS - 1), np.int8(-1))
        scores.add(p_free, p_occupied, truth == 0, truth == 1, ring)
    return scores
