"""A network of the paper with what its greys mean, which is kept with its weights."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from predictor.networks import ARCHITECTURES
from predictor.networks.grey_map import literal
from predictor.networks.image_config import ImageConfig
from predictor.networks.mlp import MLP
from predictor.networks.resnet_ff import ResNet
from predictor.networks.unet_ff import UNet


class ImageNet(nn.Module):
    """A network, and the probabilities of free and occupied at each level of grey.

    Args:
        config: its shape and meaning.
    """

    ARCHITECTURES = tuple(f"foresee-{name}-1" for name in ARCHITECTURES)
    """What files of weights call it; another number when a network changes its meaning."""
    CONFIG = ImageConfig

    def __init__(self, config: ImageConfig) -> None:
        super().__init__()
        self.config = config
        self.net = _network(config)
        self.chances: Tensor
        """(2, LEVELS), see `grey_map`; until it is fitted, greys at their word."""
        self.register_buffer("chances", torch.from_numpy(literal()).float())

    @property
    def architecture(self) -> str:
        """What a file of these weights calls it."""
        return self.ARCHITECTURES[ARCHITECTURES.index(self.config.arch)]

    def forward(self, images: Tensor) -> Tensor:
        """(B, 1, side, side) to the same, in [-1, 1]."""
        out: Tensor = self.net(images)
        return out


def _network(config: ImageConfig) -> nn.Module:
    """The generator, where there is more to an architecture than that."""
    if config.arch == "mlp":
        return MLP(config.side, config.width)
    if config.arch == "resnet_ff":
        return ResNet(config.width, config.over)

    return UNet(config.side, config.width, config.over)
