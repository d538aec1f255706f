"""Batches of inputs and targets, made from samples and squares; and the losses of compact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from predictor.data.squares import NOTHING, Square, middle, parted
from predictor.mapping.context import CELLS
from predictor.networks.compact_net import FREE, ROOM
from predictor.networks.image import image_of
from predictor.networks.image_config import ImageConfig
from predictor.networks.room import REACH, question, widened


def batch_of(samples: list[NDArray[np.uint8]], side: int, mirror: NDArray[np.bool_]) -> Tensor:
    """Return the middles of some samples, (B, side, side) uint8 codes.

    Args:
        samples: codes, each (SIDE, SIDE).
        side: side of the middle [cells].
        mirror: which samples to mirror across the heading, (B,).
    """
    out = np.empty((len(samples), side, side), dtype=np.uint8)
    for number, codes in enumerate(samples):
        square = middle(codes, side)
        out[number] = square[::-1] if mirror[number] else square
    return torch.from_numpy(out)


def contexts_of(
    contexts: list[NDArray[np.uint8]],
    mirror: NDArray[np.bool_],
    alone: NDArray[np.bool_],
    side: int,
) -> Tensor:
    """Return the contexts of some samples, (B, 2, CELLS, CELLS), in [0, 1].

    Args:
        contexts: percentages, each (2, CELLS, CELLS).
        mirror: which samples to mirror across the heading, (B,).
        alone: which samples to leave without all that lies beyond their own square, (B,).
        side: side of that square [cells of a sample].
    """
    out = np.stack(contexts)
    out[mirror] = out[mirror, :, ::-1]
    edge = (CELLS - side // 10) // 2
    inside = out[alone, :, edge : CELLS - edge, edge : CELLS - edge]
    out[alone] = 0
    out[alone, :, edge : CELLS - edge, edge : CELLS - edge] = inside
    return torch.from_numpy(out).float() / 100.0


def known_of(codes: Tensor) -> Tensor:
    """Return the input (B, 2, H, W) for codes (B, H, W): observed free, observed occupied."""
    seen, _ = parted(codes)
    known = torch.stack([seen == 0, seen == 1], dim=1).float()
    return known.to(memory_format=torch.channels_last)


NEAR = ((5, 2.0), (10, 1.0), (20, 0.5))
"""Distances from what was observed [cells], and how much more a cell weighs that is nearer: the
plans of a car rely upon such cells first."""


def losses(logits: Tensor, codes: Tensor) -> tuple[Tensor, Tensor]:
    """Compute the mean negative log-likelihood of unobserved cells: of the classes, and of ROOM.

    The classes' mean is weighted by `NEAR`. The weights depend on the input alone, so that the
    score stays proper.

    Args:
        logits: (B, 4, H, W).
        codes: (B, H, W).
    """
    seen, truth = parted(codes)
    truth, unseen = truth.long(), seen == NOTHING
    logs = F.log_softmax(logits[:, :ROOM], dim=1)
    of_truth = logs.gather(1, truth[:, None])[:, 0]
    room, asked = room_of(codes)
    # A car's square that reaches beyond the map is left out: its truth is unknown.
    asked = F.pad(asked[:, REACH:-REACH, REACH:-REACH], (REACH, REACH, REACH, REACH))
    weight = unseen * nearness(seen)
    of_room = F.binary_cross_entropy_with_logits(logits[:, ROOM], room.float(), reduction="none")
    return (
        -(of_truth * weight).sum() / weight.sum().clamp(min=1),
        (of_room * asked).sum() / asked.sum().clamp(min=1),
    )


def nearness(seen: Tensor) -> Tensor:
    """Return the weight of each cell by its distance from what was observed, (B, H, W)."""
    reached, near = 0, (seen != NOTHING).byte()
    weight = torch.ones(seen.shape, device=seen.device)
    for distance, more in NEAR:
        near, reached = widened(near, distance - reached), distance
        weight += more * near
    return weight


def room_of(codes: Tensor) -> tuple[Tensor, Tensor]:
    """Return where a cell truly has room, and where that is not yet observed: (B, H, W) bool."""
    seen, truth = parted(codes)
    return widened((truth != FREE).byte()) == 0, question(seen)[1]


def images_of(
    squares: Sequence[Square], config: ImageConfig
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Return the images that a network of the paper is given and asked for.

    Args:
        squares: squares of the network's expansion.
        config: the network.

    Returns:
        Two arrays, each (B, 1, side, side).
    """
    given = np.stack(
        [square.crop if config.given == "crop" else square.window for square in squares]
    )
    wanted = np.stack([square.truth for square in squares])
    return image_of(given[:, None], config.side), image_of(wanted[:, None], config.side)
