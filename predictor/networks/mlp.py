"""mlp: the paper's baseline, a multilayer perceptron of 5 layers.

    image   (B, 65536)        256 × 256: free +1, unobserved 0, occupied -1
    hidden  (B,   512)        ReLU, four times
    image   (B, 65536)        tanh

The paper states no hidden width. With 512 it has 67,962,880 parameters, about as many as `unet_ff`.
"""

from __future__ import annotations

from itertools import pairwise

from torch import Tensor, nn

HIDDEN = 512


class MLP(nn.Module):
    """The network described at the head of this file.

    Args:
        side: side of the images [pixels].
        width: factor of the hidden layers' width.
    """

    def __init__(self, side: int, width: float) -> None:
        super().__init__()
        hidden = max(1, round(width * HIDDEN))
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise([side**2, *4 * [hidden], side**2]):
            layers += [nn.Linear(inputs, outputs), nn.ReLU()]
        self.layers = nn.Sequential(*layers[:-1], nn.Tanh())

    def forward(self, x: Tensor) -> Tensor:
        """Return images (B, 1, side, side) in [-1, 1] for images of the same shape."""
        out: Tensor = self.layers(x.flatten(1)).reshape(x.shape)
        return out
