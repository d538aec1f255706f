"""The class ROOM: whether the square around a cell, as wide as a car, is free."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

REACH = 3
"""Half the width of the square of ROOM [cells], without the middle cell: the square is 0.35 m wide,
the width of a car plus one cell."""


def question(seen: Tensor) -> tuple[Tensor, Tensor]:
    """Find the cells without room, and those whose room is not known yet.

    Args:
        seen: codes 0 free, 1 occupied, 2 unobserved, (B, H, W).

    Returns:
        Two masks (B, H, W): cells whose square contains a cell observed occupied, and cells whose
        square contains none, but an unobserved cell. The squares of all others were observed free.
    """
    barred = widened((seen == 1).byte()) > 0
    return barred, (widened((seen == 2).byte()) > 0) & ~barred


def widened(values: Tensor, reach: int = REACH) -> Tensor:
    """Return the largest value in the square around each cell, (B, H, W).

    Args:
        values: value of each cell, at least 0, (B, H, W).
        reach: half the width of the square, without the middle cell [cells].
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
