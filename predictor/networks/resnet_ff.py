"""resnet_ff: the image transformation network of Johnson et al. 2016, with 9 residual blocks.

Johnson et al. 2016 (perceptual losses); He et al. 2015 (residual blocks); Zhu et al. 2017
(CycleGAN), whose generator for 256 × 256 this is:

    image   (B,   1, 256, 256)        free +1, unobserved 0, occupied -1
    stem    (B,  64, 256, 256)        7 × 7
    down    (B, 128, 128, 128)        3 × 3, stride 2
    down    (B, 256,  64,  64)        3 × 3, stride 2
    blocks  (B, 256,  64,  64)        9 of two 3 × 3 each
    up      (B, 128, 128, 128)        3 × 3, stride 1/2
    up      (B,  64, 256, 256)        3 × 3, stride 1/2
    head    (B,   1, 256, 256)        7 × 7, tanh

It has 11,370,881 parameters, and takes images whose side is any multiple of 4. Dropout of 0.5 is
inside the blocks, as in the code of pix2pix.
"""

from __future__ import annotations

from torch import Tensor, nn

from predictor.networks.normalisation import make_norm

BLOCKS = 9


class ResNet(nn.Module):
    """The network described at the head of this file.

    Args:
        width: factor of the number of channels.
        over: "image" or "batch", see `predictor.networks.normalisation`.
    """

    def __init__(self, width: float, over: str) -> None:
        super().__init__()
        fine, middle, coarse = (max(1, round(width * channels)) for channels in (64, 128, 256))
        layers: list[nn.Module] = [nn.ReflectionPad2d(3), nn.Conv2d(1, fine, 7, bias=False)]
        layers += [make_norm(over, fine), nn.ReLU()]
        for inputs, outputs in ((fine, middle), (middle, coarse)):
            layers.append(nn.Conv2d(inputs, outputs, 3, 2, 1, bias=False))
            layers += [make_norm(over, outputs), nn.ReLU()]
        layers += [Block(coarse, over) for _ in range(BLOCKS)]
        for inputs, outputs in ((coarse, middle), (middle, fine)):
            layers.append(nn.ConvTranspose2d(inputs, outputs, 3, 2, 1, 1, bias=False))
            layers += [make_norm(over, outputs), nn.ReLU()]
        layers += [nn.ReflectionPad2d(3), nn.Conv2d(fine, 1, 7), nn.Tanh()]
        self.layers = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        """Return images (B, 1, side, side) in [-1, 1] for images of the same shape."""
        out: Tensor = self.layers(x)
        return out


class Block(nn.Module):
    """A residual block: x + two 3 × 3 convolutions."""

    def __init__(self, width: int, over: str) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.ReflectionPad2d(1),
            nn.Conv2d(width, width, 3, bias=False),
            make_norm(over, width),
            nn.ReLU(),
            nn.Dropout(),
            nn.ReflectionPad2d(1),
            nn.Conv2d(width, width, 3, bias=False),
            make_norm(over, width),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return features (B, C, H, W) for features of the same shape."""
        out: Tensor = x + self.layers(x)
        return out
