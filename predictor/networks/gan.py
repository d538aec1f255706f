"""gan: the U-Net of `unet_ff`, trained against a discriminator (Isola et al. 2017, pix2pix).

The discriminator sees a pair, the input and an image that may be true or generated, and classifies
each patch. It is pix2pix's for patches of 286 × 286, whose widths the paper prints:

    pair    (B,   2, 256, 256)
    c1      (B,  64, 128, 128)        4 × 4, stride 2, not normalised
    c2      (B, 128,  64,  64)        4 × 4, stride 2
    c3      (B, 256,  32,  32)        4 × 4, stride 2
    c4      (B, 512,  16,  16)        4 × 4, stride 2
    c5      (B, 512,   8,   8)        4 × 4, stride 2
    c6      (B, 512,   7,   7)        4 × 4, stride 1
    logits  (B,   1,   6,   6)        4 × 4, stride 1: more than 0: true

11,155,265 parameters. Smaller images have fewer layers (128 has 5 and 64 has 4), and 6 × 6
patches too.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.networks.normalisation import norm_of

L1_WEIGHT = 100.0
"""Weight of the L1 loss beside the adversarial one, from pix2pix; the paper gives none."""


class Discriminator(nn.Module):
    """The network described at the head of this file.

    Args:
        side: side of the images [pixels], a power of two, at least 16.
        width: factor of the number of channels.
        over: what is normalised over, see `predictor.networks.normalisation`.
    """

    def __init__(self, side: int, width: float, over: str) -> None:
        super().__init__()
        count = side.bit_length() - 3
        widths = [max(1, round(width * min(64 * 2**layer, 512))) for layer in range(count)]
        layers: list[nn.Module] = [nn.Conv2d(2, widths[0], 4, 2, 1), nn.LeakyReLU(0.2)]
        for layer in range(1, count):
            stride = 2 if layer < count - 1 else 1
            layers.append(nn.Conv2d(widths[layer - 1], widths[layer], 4, stride, 1, bias=False))
            layers += [norm_of(over, widths[layer]), nn.LeakyReLU(0.2)]
        layers.append(nn.Conv2d(widths[-1], 1, 4, 1, 1))
        self.layers = nn.Sequential(*layers)

    def forward(self, given: Tensor, claimed: Tensor) -> Tensor:
        """Return logits (B, 1, 6, 6) that images (B, 1, side, side) are an input and its truth."""
        out: Tensor = self.layers(torch.cat([given, claimed], dim=1))
        return out


def judged(logits: Tensor, true: bool) -> Tensor:
    """Return the binary cross-entropy of patches that are true, or that are not."""
    return F.binary_cross_entropy_with_logits(logits, torch.full_like(logits, float(true)))
