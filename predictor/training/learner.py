"""One step of learning: by L1 alone, or against a discriminator."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.networks.gan import L1_WEIGHT, Discriminator, judged
from predictor.networks.image_config import ImageTraining
from predictor.networks.image_net import ImageNet
from predictor.networks.initialisation import initialise
from predictor.training.group import Group

BETAS = (0.5, 0.999)
"""Of Adam: the paper's."""


class Learner:
    """A network that learns to print what is true, pixel by pixel: the paper's L1 loss.

    Args:
        net: the network; its weights are drawn anew.
        training: how.
        group: the processes that learn together.
    """

    LOSSES: tuple[str, ...] = ("l1",)
    """Names of what `learn` returns."""

    def __init__(self, net: ImageNet, training: ImageTraining, group: Group) -> None:
        self.net, self.training, self.group = net, training, group
        self.parts: dict[str, nn.Module] = {"net": net.net}
        initialise(net.net, training.sigma)
        self._generate = group.shared(net.net)
        self.optimizers = {"net": self._adam(net.net)}

    def learn(self, given: Tensor, wanted: Tensor, rate: float) -> Tensor:
        """One step; the losses before it, (len(LOSSES),).

        Args:
            given: images of this process's share, (B, 1, side, side).
            wanted: likewise.
            rate: learning rate.
        """
        with self._brief():
            claimed = self._generate(given)
        loss = F.l1_loss(claimed.to(wanted.dtype), wanted)
        self._descend("net", loss, rate)
        return loss.detach()[None]

    def state(self) -> dict[str, Any]:
        """All that changes while it learns."""
        return {
            "parts": {name: part.state_dict() for name, part in self.parts.items()},
            "optimizers": {name: adam.state_dict() for name, adam in self.optimizers.items()},
        }

    def load(self, state: dict[str, Any]) -> None:
        """Go back to a `state`."""
        for name, part in self.parts.items():
            part.load_state_dict(state["parts"][name])
            self.optimizers[name].load_state_dict(state["optimizers"][name])

    def _adam(self, part: nn.Module) -> torch.optim.Adam:
        return torch.optim.Adam(part.parameters(), self.training.rate, BETAS)

    def _brief(self) -> torch.autocast:
        return torch.autocast(self.group.device.type, torch.bfloat16, enabled=self.training.brief)

    def _descend(self, name: str, loss: Tensor, rate: float) -> None:
        adam = self.optimizers[name]
        for settings in adam.param_groups:
            settings["lr"] = rate
        adam.zero_grad(set_to_none=True)
        loss.backward()
        adam.step()


class Adversary(Learner):
    """A network that must also convince a discriminator, which learns beside it (pix2pix).

    Args:
        net: the generator; its weights are drawn anew.
        training: how.
        group: the processes that learn together.
    """

    LOSSES = ("l1", "adversarial", "discriminator")

    def __init__(self, net: ImageNet, training: ImageTraining, group: Group) -> None:
        super().__init__(net, training, group)
        config = net.config
        like = next(net.net.parameters())
        self.judge = Discriminator(config.side, config.width, config.over).to(like)
        initialise(self.judge, training.sigma)
        self.parts["judge"] = self.judge
        self._judge = group.shared(self.judge)
        self.optimizers["judge"] = self._adam(self.judge)

    def learn(self, given: Tensor, wanted: Tensor, rate: float) -> Tensor:
        """One step of both, the discriminator's first; see `Learner.learn`."""
        with self._brief():
            claimed = self._generate(given)
            self.judge.requires_grad_(True)
            of_claimed = self._judge(given, claimed.detach())
            of_wanted = self._judge(given, wanted)
        # Halved, so that it learns more slowly than what it judges.
        doubt = 0.5 * (
            judged(of_claimed.to(wanted.dtype), False) + judged(of_wanted.to(wanted.dtype), True)
        )
        self._descend("judge", doubt, rate)
        # Not by `_judge`: the generator's loss gives the discriminator no gradients to share.
        self.judge.requires_grad_(False)
        with self._brief():
            of_claimed = self.judge(given, claimed)
        belief = judged(of_claimed.to(wanted.dtype), True)
        l1 = F.l1_loss(claimed.to(wanted.dtype), wanted)
        self._descend("net", belief + L1_WEIGHT * l1, rate)
        return torch.stack([l1, belief, doubt]).detach()
