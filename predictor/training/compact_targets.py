"""Batches of inputs and targets of the compact network, from samples, and its losses."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from foresee.mapping.context import CELLS
from predictor.data.squares import NOTHING, parted
from predictor.networks.compact_net import FREE, ROOM, ROOM_REACH, room_masks, widened


def middle_squares(codes: Tensor, side: int, mirror: Tensor) -> Tensor:
    """Return the middle squares of codes (B, SIDE, SIDE), (B, side, side).

    Args:
        codes: codes of some samples.
        side: side of the middle [cells].
        mirror: which samples to mirror across the heading, (B,).
    """
    first = (codes.shape[1] - side) // 2
    squares = codes[:, first : first + side, first : first + side]
    return mirrored(squares[:, None], mirror)[:, 0]


def mirrored(maps: Tensor, mirror: Tensor) -> Tensor:
    """Return maps (B, C, H, W), some of them mirrored across the heading."""
    return torch.where(mirror[:, None, None, None], maps.flip(2), maps)


def contexts(coarse: Tensor, mirror: Tensor, alone: Tensor, side: int) -> Tensor:
    """Return the contexts of some samples, (B, 2, CELLS, CELLS), in [0, 1].

    Args:
        coarse: contexts of the samples in percent, (B, 2, CELLS, CELLS) uint8.
        mirror: which samples to mirror across the heading, (B,).
        alone: samples whose context is cleared outside of their own square, (B,).
        side: side of that square [cells of a sample].
    """
    shares = mirrored(coarse, mirror).float() / 100.0
    edge = (CELLS - side // 10) // 2
    inside = torch.zeros(CELLS, dtype=torch.bool, device=coarse.device)
    inside[edge : CELLS - edge] = True
    kept = ~alone[:, None, None, None] | (inside[:, None] & inside)
    return shares * kept


def known_input(codes: Tensor) -> Tensor:
    """Return the input (B, 2, H, W) for codes (B, H, W): observed free, observed occupied."""
    seen, _ = parted(codes)
    known = torch.stack([seen == 0, seen == 1], dim=1).float()
    return known.to(memory_format=torch.channels_last)


NEAR = ((5, 2.0), (10, 1.0), (20, 0.5))
"""Pairs of a distance from the observed cells [cells], and the weight that is added to unobserved
cells nearer than that: plans rely on near cells first."""


def losses(logits: Tensor, codes: Tensor) -> tuple[Tensor, Tensor]:
    """Compute the mean negative log-likelihood of unobserved cells, of the classes and of ROOM.

    The mean of the classes is weighted by `NEAR`. The weights depend on the input alone, so that
    the score stays proper.

    Args:
        logits: output of the network, (B, 4, H, W).
        codes: codes of the samples, (B, H, W).

    Returns:
        The loss of the classes, and the loss of ROOM.
    """
    seen, truth = parted(codes)
    truth, unseen = truth.long(), seen == NOTHING
    logs = F.log_softmax(logits[:, :ROOM], dim=1)
    of_truth = logs.gather(1, truth[:, None])[:, 0]
    room, asked = room_targets(codes)
    # Squares of ROOM that reach beyond the map are left out, since their truth is unknown.
    asked = F.pad(
        asked[:, ROOM_REACH:-ROOM_REACH, ROOM_REACH:-ROOM_REACH],
        (ROOM_REACH, ROOM_REACH, ROOM_REACH, ROOM_REACH),
    )
    weight = unseen * nearness(seen)
    of_room = F.binary_cross_entropy_with_logits(logits[:, ROOM], room.float(), reduction="none")
    return (
        -(of_truth * weight).sum() / weight.sum().clamp(min=1),
        (of_room * asked).sum() / asked.sum().clamp(min=1),
    )


def nearness(seen: Tensor) -> Tensor:
    """Return the weight of each cell by its distance from the observed cells, (B, H, W)."""
    reached, near = 0, (seen != NOTHING).byte()
    weight = torch.ones(seen.shape, device=seen.device)
    for distance, more in NEAR:
        near, reached = widened(near, distance - reached), distance
        weight += more * near
    return weight


def room_targets(codes: Tensor) -> tuple[Tensor, Tensor]:
    """Return the cells that truly have room, and those whose room is not known yet, (B, H, W)."""
    seen, truth = parted(codes)
    return widened((truth != FREE).byte()) == 0, room_masks(seen)[1]
