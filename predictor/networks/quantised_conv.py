"""Convolutions in 8-bit integers, for inference: quantisation after training (Jacob et al. 2018).

A runtime with integer arithmetic computes them twice as fast as in 32-bit floating-point numbers;
others simulate the rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

INPUT_LEVELS = 255
"""Largest integer of an input."""
WEIGHT_LEVELS = 63
"""Largest integer of a weight. Processors without AVX-512 VNNI add two products in 16 bits, so that
larger ones would overflow there: 2 · 255 · 63 < 2¹⁵."""
LEAST_RANGE = 1e-6
"""Smallest range of an input or of the weights of a channel."""


class QuantisedConv(nn.Module):
    """A convolution, possibly transposed, whose weights and inputs are rounded to integers.

    The weights of each output channel have a scale of their own, the inputs have one together.
    Inputs outside their range are clipped.

    Args:
        conv: convolution.
        lowest: lowest input.
        highest: highest input.
    """

    def __init__(self, conv: nn.Conv2d | nn.ConvTranspose2d, lowest: float, highest: float) -> None:
        super().__init__()
        self.conv = conv
        largest = max(abs(lowest), abs(highest), LEAST_RANGE)
        signed = lowest < 0.0
        self.levels = (-(INPUT_LEVELS // 2) - 1, INPUT_LEVELS // 2) if signed else (0, INPUT_LEVELS)
        self.input_scale = largest / self.levels[1]
        self.transposed = isinstance(conv, nn.ConvTranspose2d)
        self.axis = 1 if self.transposed else 0
        others = [axis for axis in range(4) if axis != self.axis]
        scales = conv.weight.detach().abs().amax(dim=others).clamp(min=LEAST_RANGE) / WEIGHT_LEVELS
        self.scales: Tensor
        self.zeros: Tensor
        self.register_buffer("scales", scales)
        self.register_buffer("zeros", torch.zeros_like(scales, dtype=torch.int32))
        with torch.no_grad():
            conv.weight.copy_(self._rounded(conv.weight))

    def forward(self, x: Tensor) -> Tensor:
        """Return what the convolution makes of the rounded input."""
        x = torch.fake_quantize_per_tensor_affine(x, self.input_scale, 0, *self.levels)
        conv = self.conv
        # A runtime sees by this operation that the weights are integers.
        tracing = torch.jit.is_tracing()  # type: ignore[attr-defined]
        weight = self._rounded(conv.weight) if tracing else conv.weight
        assert not isinstance(conv.padding, str)
        convolve = F.conv_transpose2d if self.transposed else F.conv2d
        return convolve(x, weight, conv.bias, conv.stride, conv.padding)

    def _rounded(self, weight: Tensor) -> Tensor:
        # Twice as many levels as are used, since runtimes know integers of 8 bits, and not of 7.
        return torch.fake_quantize_per_channel_affine(
            weight,
            self.scales,
            self.zeros,
            self.axis,
            -2 * WEIGHT_LEVELS - 1,
            2 * WEIGHT_LEVELS + 1,
        )


def convolutions(net: nn.Module) -> list[tuple[nn.Module, str]]:
    """Return the convolutions of a network in a fixed order, each as its parent and name."""
    return [
        (parent, name)
        for parent in net.modules()
        for name, child in parent.named_children()
        if isinstance(child, (nn.Conv2d, nn.ConvTranspose2d))
    ]


def quantise(places: Sequence[tuple[nn.Module, str]], ranges: Tensor) -> None:
    """Replace convolutions by quantised ones, in place.

    Args:
        places: from `convolutions`.
        ranges: lowest and highest input of each, (n, 2).
    """
    for (parent, name), (lowest, highest) in zip(places, ranges.tolist(), strict=True):
        setattr(parent, name, QuantisedConv(getattr(parent, name), lowest, highest))


def input_ranges(places: Sequence[tuple[nn.Module, str]], run: Callable[[], object]) -> Tensor:
    """Return the lowest and highest input of each convolution while `run` runs them, (n, 2)."""
    found = torch.zeros(len(places), 2)

    def watch(number: int) -> Callable[[nn.Module, tuple[Tensor, ...]], None]:
        def see(module: nn.Module, given: tuple[Tensor, ...]) -> None:
            found[number, 0] = min(float(found[number, 0]), float(given[0].detach().min()))
            found[number, 1] = max(float(found[number, 1]), float(given[0].detach().max()))

        return see

    hooks = [
        getattr(parent, name).register_forward_pre_hook(watch(number))
        for number, (parent, name) in enumerate(places)
    ]
    try:
        run()
    finally:
        for hook in hooks:
            hook.remove()
    return found
