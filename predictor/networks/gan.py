"""The discriminator of `gan`: the U-Net of `unet_ff`, trained as pix2pix (Isola et al. 2017).

The discriminator gets a pair of images, the input and either the truth or the generated image, and
classifies each patch as true or generated. It is that of pix2pix for patches of 286 × 286, whose
widths the paper prints:

    pair    (B,   2, 256, 256)
    c1      (B,  64, 128, 128)        4 × 4, stride 2, not normalised
    c2      (B, 128,  64,  64)        4 × 4, stride 2
    c3      (B, 256,  32,  32)        4 × 4, stride 2
    c4      (B, 512,  16,  16)        4 × 4, stride 2
    c5      (B, 512,   8,   8)        4 × 4, stride 2
    c6      (B, 512,   7,   7)        4 × 4, stride 1
    logits  (B,   1,   6,   6)        4 × 4, stride 1: more than 0: true

It has 11,155,265 parameters. For smaller images there are fewer layers (5 for 128 pixels, 4 for
64), and also 6 × 6 patches.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.networks.normalisation import make_norm

L1_WEIGHT = 100.0
"""Weight of the L1 loss relative to the adversarial loss, from pix2pix; the paper states none."""


class Discriminator(nn.Module):
    """The network described at the head of this file.

    Args:
        side: side of the images [pixels], a power of two, at least 16.
        width: factor of the number of channels.
        over: "image" or "batch", see `predictor.networks.normalisation`.
    """

    def __init__(self, side: int, width: float, over: str) -> None:
        super().__init__()
        count = side.bit_length() - 3
        widths = [max(1, round(width * min(64 * 2**layer, 512))) for layer in range(count)]
        layers: list[nn.Module] = [nn.Conv2d(2, widths[0], 4, 2, 1), nn.LeakyReLU(0.2)]
        for layer in range(1, count):
            stride = 2 if layer < count - 1 else 1
            layers.append(nn.Conv2d(widths[layer - 1], widths[layer], 4, stride, 1, bias=False))
            layers += [make_norm(over, widths[layer]), nn.LeakyReLU(0.2)]
        layers.append(nn.Conv2d(widths[-1], 1, 4, 1, 1))
        self.layers = nn.Sequential(*layers)

    def forward(self, given: Tensor, claimed: Tensor) -> Tensor:
        """Return the logits of the patches, (B, 1, 6, 6), above 0 if they look true.

        Args:
            given: input images, (B, 1, side, side).
            claimed: true or generated images for them, (B, 1, side, side).
        """
        out: Tensor = self.layers(torch.cat([given, claimed], dim=1))
        return out


def judged(logits: Tensor, true: bool) -> Tensor:
    """Return the mean binary cross-entropy of the discriminator's logits.

    Args:
        logits: logits of all patches.
        true: whether the correct class is "true" rather than "generated".
    """
    return F.binary_cross_entropy_with_logits(logits, torch.full_like(logits, float(true)))
