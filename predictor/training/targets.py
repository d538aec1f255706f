"""From samples to what a network is given and what it is asked for, a batch at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from predictor.data.squares import NOTHING, Square, middle, parted
from predictor.networks.compact_net import FREE, ROOM
from predictor.networks.image import image_of
from predictor.networks.image_config import ImageConfig
from predictor.networks.room import REACH, question, widened


def batch_of(samples: list[NDArray[np.uint8]], side: int, mirror: NDArray[np.bool_]) -> Tensor:
    """The middles of some samples, (B, side, side) uint8 codes.

    Args:
        samples: codes, each (SIDE, SIDE).
        side: of the middle [cells].
        mirror: which to mirror across the heading, (B,).
    """
    out = np.empty((len(samples), side, side), dtype=np.uint8)
    for number, codes in enumerate(samples):
        square = middle(codes, side)
        out[number] = square[::-1] if mirror[number] else square
    return torch.from_numpy(out)


def known_of(codes: Tensor) -> Tensor:
    """The network's input (B, 2, H, W) of codes (B, H, W): seen free, seen occupied."""
    seen, _ = parted(codes)
    known = torch.stack([seen == 0, seen == 1], dim=1).float()
    return known.to(memory_format=torch.channels_last)


def losses(logits: Tensor, codes: Tensor) -> tuple[Tensor, Tensor]:
    """Mean negative log-likelihood [nat] of what was not seen: of the classes, and of ROOM.

    Args:
        logits: (B, 4, H, W).
        codes: (B, H, W).
    """
    seen, truth = parted(codes)
    truth, unseen = truth.long(), seen == NOTHING
    logs = F.log_softmax(logits[:, :ROOM], dim=1)
    of_truth = logs.gather(1, truth[:, None])[:, 0]
    room, asked = room_of(codes)
    # A square that reaches out of the map is no question: what lies out there is not said.
    asked = F.pad(asked[:, REACH:-REACH, REACH:-REACH], (REACH, REACH, REACH, REACH))
    of_room = F.binary_cross_entropy_with_logits(logits[:, ROOM], room.float(), reduction="none")
    return (
        -(of_truth * unseen).sum() / unseen.sum().clamp(min=1),
        (of_room * asked).sum() / asked.sum().clamp(min=1),
    )


def room_of(codes: Tensor) -> tuple[Tensor, Tensor]:
    """Where there is truly room around a cell, and where that is a question: (B, H, W) bool."""
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
