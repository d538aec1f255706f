"""Normalisation of channels: over each image, or over a batch.

With a batch of one, as in the paper, batch normalisation uses the statistics of the image itself,
and pix2pix does so at prediction too. With larger batches the statistics are those of the batch,
and at prediction their running average.
"""

from __future__ import annotations

from torch import nn


def make_norm(over: str, channels: int) -> nn.Module:
    """Return the normalisation of a layer.

    Args:
        over: "image" or "batch".
        channels: number of channels of the layer.
    """
    return nn.InstanceNorm2d(channels, affine=True) if over == "image" else nn.BatchNorm2d(channels)
