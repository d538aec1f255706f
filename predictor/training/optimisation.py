"""Steps of an optimiser, and the state of networks and optimisers."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn


def deterministic(seed: int) -> None:
    """Seed torch, and make cuDNN use deterministic algorithms only."""
    torch.backends.cudnn.deterministic = True
    torch.manual_seed(seed)


def cosine(step: int, steps: int) -> float:
    """Return the factor of the learning rate, which falls along a cosine from 1 to 0."""
    return 0.5 * (1.0 + math.cos(math.pi * step / steps))


def descend(
    optimizer: torch.optim.Optimizer, loss: Tensor, rate: float, clipped: nn.Module | None = None
) -> None:
    """Make one optimiser step.

    Args:
        optimizer: optimiser of the parameters to change.
        loss: loss whose gradients it follows.
        rate: learning rate.
        clipped: network the norm of whose gradients is limited to 1; None: no limit.
    """
    for settings in optimizer.param_groups:
        settings["lr"] = rate
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    if clipped is not None:
        nn.utils.clip_grad_norm_(clipped.parameters(), 1.0)
    optimizer.step()


def states(parts: dict[str, Any]) -> dict[str, Any]:
    """Return the state of each network or optimiser."""
    return {name: part.state_dict() for name, part in parts.items()}


def restore(parts: dict[str, Any], state: dict[str, Any]) -> None:
    """Restore what `states` returned."""
    for name, part in parts.items():
        part.load_state_dict(state[name])
