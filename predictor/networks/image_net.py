"""A network of the paper by its name, and the calibration of its greys, saved with the weights."""

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
        config: architecture and shape.
    """

    ARCHITECTURES = tuple(f"foresee-{name}-1" for name in ARCHITECTURES)
    """Names in files of weights; the number changes when the meaning of weights does."""
    CONFIG = ImageConfig

    def __init__(self, config: ImageConfig) -> None:
        super().__init__()
        self.config = config
        # For "gan", this is the generator.
        if config.arch == "mlp":
            self.net: nn.Module = MLP(config.side, config.width)
        elif config.arch == "resnet_ff":
            self.net = ResNet(config.width, config.over)
        else:
            self.net = UNet(config.side, config.width, config.over)
        self.chances: Tensor
        """p_free and p_occupied at each level of grey, (2, LEVELS), see `grey_map`; `literal` until
        they are fitted."""
        self.register_buffer("chances", torch.from_numpy(literal()).float())

    @property
    def architecture(self) -> str:
        """Name in a file of these weights."""
        return self.ARCHITECTURES[ARCHITECTURES.index(self.config.arch)]

    def forward(self, images: Tensor) -> Tensor:
        """Return images (B, 1, side, side) in [-1, 1] for images of the same shape."""
        out: Tensor = self.net(images)
        return out
