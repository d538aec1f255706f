"""Initial weights, drawn from a normal distribution as in pix2pix (Isola et al. 2017)."""

from __future__ import annotations

from torch import nn


def initialise(net: nn.Module, sigma: float) -> None:
    """Draw the initial weights of a network, in place.

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
