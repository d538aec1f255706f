"""The training of a network on samples of walks and logs; the exported weights are averages."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from predictor.data.samples import Samples
from predictor.networks.compact_net import CompactNet
from predictor.runtime import fastest_device
from predictor.training.checkpoint import TrainError
from predictor.training.optimisation import cosine, descend
from predictor.training.settings import SamplesTraining
from predictor.training.trainer import Trainer, common_facts
from predictor.weights import save_weights


class SamplesTrainer(Trainer):
    """A training on samples.

    Args:
        config: settings of the training.
        train: training samples.
        validation: validation samples.
        weights: file of the weights; its folder also contains checkpoint, log and curve.
        net: network to train.
        before: facts of the training of the network to start from; empty: random weights.
        facts: further facts that identify this training.
        helper: network of auxiliary tasks, which is used in training only, or None.

    Raises:
        TrainError: if the folder holds another training, or the weights to start from have learned
            from buildings of the validation samples.
    """

    def __init__(
        self,
        config: SamplesTraining,
        train: Samples,
        validation: Samples,
        weights: Path,
        net: CompactNet,
        before: dict[str, Any],
        facts: dict[str, Any],
        helper: torch.nn.Module | None = None,
    ) -> None:
        self.config, self.train, self.validation = config, train, validation
        self.device = fastest_device()
        self.brief = self.device.type == "cuda" or bool(
            torch.cpu.get_capabilities().get("avx512_bf16")
        )
        check_unlearned(before, validation)
        self.net = net.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.helper = helper and helper.to(self.device)
        self.averaged = {name: v.detach().clone() for name, v in self.net.state_dict().items()}
        learned = [*self.net.parameters(), *(self.helper.parameters() if self.helper else ())]
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
            **facts,
        }
        for name in ("worlds", "validation_worlds"):
            facts[name] = sorted({*facts[name], *before.get(name, ())})
        # A GPU is faster than what unpacks the samples, so it holds them all.
        self.held: Tensor | None = None
        if self.device.type == "cuda":
            self.held = self._unpacked(np.arange(len(train))).to(self.device)
        note_every = max(1, min(500, config.steps // 10))
        super().__init__(weights, facts, config.steps, note_every, self.device)

    def smoothed(self) -> CompactNet:
        """Return the network with averaged weights, which is validated and exported."""
        net = type(self.net)(self.net.config)
        net.load_state_dict(self.averaged)
        return net.to(self.device, memory_format=torch.channels_last).eval()

    def _state(self) -> dict[str, Any]:
        helper = self.helper and self.helper.state_dict()
        return super()._state() | {"helper": helper, "averaged": self.averaged}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        if self.helper is not None:
            self.helper.load_state_dict(state["helper"])
        self.averaged = state["averaged"]

    def _data(self, chosen: NDArray[np.int64]) -> Tensor:
        """Return the bytes of some training samples; their numbers, if they are held already."""
        if self.held is None:
            return self._unpacked(chosen)
        return torch.from_numpy(chosen)

    def _unpacked(self, chosen: NDArray[np.int64]) -> Tensor:
        return torch.from_numpy(self.train.stacked(chosen, 100))

    def _learn(self, *batch: Any) -> list[float]:
        config, step = self.config, self.step
        self.net.train()
        data, *options = batch
        data = data.to(self.device)
        codes, coarse = Samples.parts(data if self.held is None else self.held[data])
        moved = (o.to(self.device) if isinstance(o, Tensor) else o for o in options)
        loss = self._loss(codes, coarse, *moved)
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

    @abstractmethod
    def _loss(self, codes: Tensor, coarse: Tensor, *options: Any) -> Tensor:
        """Return the loss of a batch.

        Args:
            codes: codes of the samples, (B, SIDE, SIDE).
            coarse: their coarse maps, (B, 3, FINER, FINER).
            options: the rest of the batch.
        """

    def _export(self, facts: dict[str, Any]) -> None:
        save_weights(self.weights, self._exported(), facts | {"validation": self.log[-1]})

    def _exported(self) -> CompactNet:
        """Return the network to export."""
        return self.smoothed()


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
