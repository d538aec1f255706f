"""Convolutions in 8-bit integers: post-training quantisation (Nagel et al. 2021, arXiv:2106.08295).

OpenVINO computes them in integers, which is faster than 32-bit floating-point numbers. PyTorch
simulates the rounding, which is slower.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

INPUT_MAX = 255
"""Largest integer of an input."""
WEIGHT_MAX = 63
"""Largest integer of a weight: 7 bits, as PyTorch's `reduce_range`. Processors without VNNI add two
products in 16 bits, and 2 · 255 · 127 does not fit into them."""
LEAST_RANGE = 1e-6
"""Smallest range of an input or of the weights of a channel."""


class QuantisedConv(nn.Module):
    """A convolution, possibly transposed, whose weights and inputs are rounded to integers.

    The weights of each output channel have a scale of their own, the inputs have one together.
    Inputs outside their range are clipped.

    Args:
        conv: convolution without groups, dilation or output padding, padded with zeros. Its weights
            are rounded in place.
        lowest: lowest input; inputs are signed integers if it is negative.
        highest: highest input.

    Raises:
        ValueError: if the convolution is of another kind.
    """

    def __init__(self, conv: nn.Conv2d | nn.ConvTranspose2d, lowest: float, highest: float) -> None:
        super().__init__()
        plain = conv.groups == 1 and {*conv.dilation} == {1} and not any(conv.output_padding)
        if not plain or conv.padding_mode != "zeros" or isinstance(conv.padding, str):
            raise ValueError(f"{conv} cannot be quantised")
        self.conv, self.padding = conv, conv.padding
        largest = max(abs(lowest), abs(highest), LEAST_RANGE)
        half = INPUT_MAX // 2
        self.quant_min, self.quant_max = (-half - 1, half) if lowest < 0.0 else (0, INPUT_MAX)
        self.input_scale = largest / self.quant_max
        self.transposed = isinstance(conv, nn.ConvTranspose2d)
        self.axis = 1 if self.transposed else 0
        others = [axis for axis in range(4) if axis != self.axis]
        scales = conv.weight.detach().abs().amax(dim=others).clamp(min=LEAST_RANGE) / WEIGHT_MAX
        self.weight_scales: Tensor
        self.zero_points: Tensor
        self.register_buffer("weight_scales", scales)
        self.register_buffer("zero_points", torch.zeros_like(scales, dtype=torch.int32))
        with torch.no_grad():
            conv.weight.copy_(self._rounded(conv.weight))

    def forward(self, x: Tensor) -> Tensor:
        """Return what the convolution makes of the rounded input."""
        x = torch.fake_quantize_per_tensor_affine(
            x, self.input_scale, 0, self.quant_min, self.quant_max
        )
        conv = self.conv
        # A runtime sees by this operation that the weights are integers.
        tracing = torch.jit.is_tracing()  # type: ignore[attr-defined]
        weight = self._rounded(conv.weight) if tracing else conv.weight
        convolve = F.conv_transpose2d if self.transposed else F.conv2d
        return convolve(x, weight, conv.bias, conv.stride, self.padding)

    def _rounded(self, weight: Tensor) -> Tensor:
        # Runtimes know integers of 8 bits, and not of 7.
        return torch.fake_quantize_per_channel_affine(
            weight, self.weight_scales, self.zero_points, self.axis, -127, 127
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
    """Return the lowest and highest of 0 and the inputs of each convolution, (n, 2).

    Args:
        places: from `convolutions`.
        run: function that runs their network.
    """
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
