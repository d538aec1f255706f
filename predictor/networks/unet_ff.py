"""unet_ff: the U-Net of pix2pix, which Katyal et al. 2018 train with an L1 loss alone.

Ronneberger et al. 2015 (U-Net); Isola et al. 2017 (pix2pix), whose generator for 256 × 256 this is:

    image   (B,   1, 256, 256)                free +1, unobserved 0, occupied -1
    e1      (B,  64, 128, 128) ─────────────────────────┐
    e2      (B, 128,  64,  64) ──────────────────────┐  │
    e3      (B, 256,  32,  32) ───────────────────┐  │  │
    e4      (B, 512,  16,  16) ────────────────┐  │  │  │
    e5      (B, 512,   8,   8) ─────────────┐  │  │  │  │
    e6      (B, 512,   4,   4) ──────────┐  │  │  │  │  │
    e7      (B, 512,   2,   2) ───────┐  │  │  │  │  │  │
    e8      (B, 512,   1,   1)        │  │  │  │  │  │  │
    d1  of   512: (B, 512,   2,   2)  │  │  │  │  │  │  │
    d2  of  1024: (B, 512,   4,   4) ◀┘  │  │  │  │  │  │
    d3  of  1024: (B, 512,   8,   8) ◀───┘  │  │  │  │  │
    d4  of  1024: (B, 512,  16,  16) ◀──────┘  │  │  │  │
    d5  of  1024: (B, 256,  32,  32) ◀─────────┘  │  │  │
    d6  of   512: (B, 128,  64,  64) ◀────────────┘  │  │
    d7  of   256: (B,  64, 128, 128) ◀───────────────┘  │
    d8  of   128: (B,   1, 256, 256) ◀──────────────────┘

"of" gives the input channels of a decoder layer after concatenation, which are the widths that the
paper prints. Every layer is a 4 × 4 convolution of stride 2, up or down. The network has 54,408,385
parameters. Images of another power of two need fewer layers: 7 for 128 pixels, 6 for 64.

Where the paper is silent, this follows pix2pix: the encoder's leaky ReLUs have a slope of 0.2; the
first and the innermost encoder layers are not normalised (a 1 × 1 image has no variance); the first
three decoder layers have dropout 0.5 ("the decoder layers ... used a dropout rate of 0.50").
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.networks.normalisation import make_norm

DROPPING = 3
"""Number of decoder layers with dropout, counted from the innermost."""


class UNet(nn.Module):
    """The network described at the head of this file.

    Args:
        side: side of the images [pixels], a power of two.
        width: factor of the number of channels.
        over: "image" or "batch", see `predictor.networks.normalisation`.
    """

    def __init__(self, side: int, width: float, over: str) -> None:
        super().__init__()
        depth = side.bit_length() - 1
        widths = [max(1, round(width * min(64 * 2**layer, 512))) for layer in range(depth)]
        self.down = nn.ModuleList()
        self.up = nn.ModuleList()
        for layer, (inputs, outputs) in enumerate(zip([1, *widths], widths, strict=False)):
            plain = layer in (0, depth - 1)
            conv = nn.Conv2d(inputs, outputs, 4, 2, 1, bias=plain)
            self.down.append(conv if plain else nn.Sequential(conv, make_norm(over, outputs)))
        for layer, outputs in enumerate([*reversed(widths[:-1]), 1]):
            # Half of the input channels come from the encoder, except in the innermost layer.
            inputs = widths[-1] if layer == 0 else 2 * widths[depth - 1 - layer]
            last = layer == depth - 1
            conv_up = nn.ConvTranspose2d(inputs, outputs, 4, 2, 1, bias=last)
            rest = [] if last else [make_norm(over, outputs)]
            # `predictor.training.image_learner` sets the rate of the training.
            rest += [nn.Dropout()] if layer < DROPPING else []
            self.up.append(nn.Sequential(conv_up, *rest))

    def forward(self, x: Tensor) -> Tensor:
        """Return images (B, 1, side, side) in [-1, 1] for images of the same shape."""
        skips: list[Tensor] = []
        for down in self.down:
            x = down(F.leaky_relu(x, 0.2) if skips else x)
            skips.append(x)
        skips.pop()
        for up in self.up:
            x = up(F.relu(x))
            if skips:
                x = torch.cat([x, skips.pop()], dim=1)
        return torch.tanh(x)
