"""One training step of the paper's networks: with the L1 loss alone, or also adversarial (GAN)."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.networks.gan import L1_WEIGHT, Discriminator, judged
from predictor.networks.grey_net import GreyNet
from predictor.training.optimisation import descend, restore, states
from predictor.training.settings import ImageTraining

BETAS = (0.5, 0.999)
"""Moment decay rates of Adam, as in the paper."""


class Learner:
    """A network and its optimiser, trained with the L1 loss of pixels as in the paper.

    Args:
        net: network, whose weights are initialised here.
        training: settings of the training.
    """

    LOSSES: tuple[str, ...] = ("l1",)
    """Names of the losses that `learn` returns."""

    def __init__(self, net: GreyNet, training: ImageTraining) -> None:
        self.net, self.training = net, training
        self.parts: dict[str, nn.Module] = {"net": net.net}
        initialise(net.net, training.sigma)
        for module in net.net.modules():
            if isinstance(module, nn.Dropout):
                module.p = training.dropout
        self.optimizers = {"net": self._adam(net.net)}

    def learn(self, given: Tensor, wanted: Tensor, rate: float) -> Tensor:
        """Make one optimiser step, and return the losses before it, (len(LOSSES),).

        Args:
            given: input images, (B, 1, side, side).
            wanted: true images of the same frames, (B, 1, side, side).
            rate: learning rate.
        """
        with self._brief():
            claimed = self.net.net(given)
        loss = F.l1_loss(claimed.to(wanted.dtype), wanted)
        descend(self.optimizers["net"], loss, rate)
        return loss.detach()[None]

    def state(self) -> dict[str, Any]:
        """Return the state of networks and optimisers for a checkpoint."""
        return {"parts": states(self.parts), "optimizers": states(self.optimizers)}

    def load(self, state: dict[str, Any]) -> None:
        """Restore the state that `state` returned."""
        restore(self.parts, state["parts"])
        restore(self.optimizers, state["optimizers"])

    def _adam(self, part: nn.Module) -> torch.optim.Adam:
        return torch.optim.Adam(part.parameters(), self.training.rate, BETAS)

    def _brief(self) -> torch.autocast:
        device = next(self.net.parameters()).device
        return torch.autocast(device.type, torch.bfloat16, enabled=self.training.brief)


class Adversary(Learner):
    """A network that is trained with the L1 loss and against a discriminator, as in pix2pix.

    Args:
        net: generator, whose weights are initialised here.
        training: settings of the training.
    """

    LOSSES = ("l1", "adversarial", "discriminator")

    def __init__(self, net: GreyNet, training: ImageTraining) -> None:
        super().__init__(net, training)
        config = net.config
        like = next(net.net.parameters())
        self.judge = Discriminator(config.side, config.width, config.over).to(like)
        initialise(self.judge, training.sigma)
        self.parts["judge"] = self.judge
        self.optimizers["judge"] = self._adam(self.judge)

    def learn(self, given: Tensor, wanted: Tensor, rate: float) -> Tensor:
        """Make one step of the discriminator, then one of the generator; see `Learner.learn`."""
        with self._brief():
            claimed = self.net.net(given)
            self.judge.requires_grad_(True)
            of_claimed = self.judge(given, claimed.detach())
            of_wanted = self.judge(given, wanted)
        # Halved, so that the discriminator learns more slowly than the generator (pix2pix).
        doubt = 0.5 * (
            judged(of_claimed.to(wanted.dtype), False) + judged(of_wanted.to(wanted.dtype), True)
        )
        descend(self.optimizers["judge"], doubt, rate)
        # This loss has no gradients of the discriminator.
        self.judge.requires_grad_(False)
        with self._brief():
            of_claimed = self.judge(given, claimed)
        belief = judged(of_claimed.to(wanted.dtype), True)
        l1 = F.l1_loss(claimed.to(wanted.dtype), wanted)
        descend(self.optimizers["net"], belief + L1_WEIGHT * l1, rate)
        return torch.stack([l1, belief, doubt]).detach()


def initialise(net: nn.Module, sigma: float) -> None:
    """Draw the initial weights of a network, in place, as in pix2pix (Isola et al. 2017).

    Weights are N(0, σ), gains of normalisations N(1, σ), and biases 0.

    Args:
        net: the network.
        sigma: σ; Katyal et al. state 0.2, pix2pix has 0.02.
    """
    for module in net.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
            nn.init.normal_(module.weight, 0.0, sigma)
        elif isinstance(module, nn.BatchNorm2d | nn.InstanceNorm2d):
            nn.init.normal_(module.weight, 1.0, sigma)
        else:
            continue
        if module.bias is not None:
            nn.init.zeros_(module.bias)
