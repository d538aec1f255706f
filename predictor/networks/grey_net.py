"""A network of the paper by its name, and the calibration of its greys, saved with the weights."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from predictor.networks import ARCHITECTURES
from predictor.networks.grey_image import literal
from predictor.networks.image_config import ImageConfig
from predictor.networks.mlp import MLP
from predictor.networks.resnet_ff import ResNet
from predictor.networks.unet_ff import UNet


class GreyNet(nn.Module):
    """A network, and the probabilities of free and occupied at each level of grey.

    Args:
        config: architecture and shape.
    """

    ARCHITECTURES = tuple(f"foresee-{name}-1" for name in ARCHITECTURES)
    """Names in files of weights; the number changes when the meaning of weights does."""
    CONFIG = ImageConfig

    def __init__(self, config: ImageConfig) -> None:
        super().__init__()
        self.config = config
        self.net = _network(config)
        self.chances: Tensor
        """p_free and p_occupied at each level of grey, (2, GREY_LEVELS), see `grey_image`; before
        they are fitted, `literal`."""
        self.register_buffer("chances", torch.from_numpy(literal()).float())

    @property
    def architecture(self) -> str:
        """Name in a file of these weights."""
        return self.ARCHITECTURES[ARCHITECTURES.index(self.config.arch)]

    def forward(self, images: Tensor) -> Tensor:
        """Return images (B, 1, side, side) in [-1, 1] for images of the same shape."""
        out: Tensor = self.net(images)
        return out


def _network(config: ImageConfig) -> nn.Module:
    """Return the network of an architecture with random weights; of a GAN, its generator."""
    if config.arch in ("unet_ff", "gan"):
        return UNet(config.side, config.width, config.over)
    if config.arch == "resnet_ff":
        return ResNet(config.width, config.over)
    if config.arch == "mlp":
        return MLP(config.side, config.width)
    raise ValueError(f"no network is written for the architecture {config.arch!r}")
