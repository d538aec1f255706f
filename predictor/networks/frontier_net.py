"""The network of frontiers: from the surroundings of a frontier to where it leads.

picture (B, 3, 80, 80), and two channels of the distance to the goal
  convolutions of stride 2     (B, 16, 40, 40) (B, 32, 20, 20) (B, 48, 10, 10) (B, 64, 5, 5)
mean, maximum and middle of the features, and three numbers  (B, 195)
  two hidden layers            (B, 96)
leads (logit), way, back       (B, 3)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from predictor.data.frontier_samples import CELL, SIDE

SCALE = 10.0
"""Unit of the network's distances [m]."""
FARTHEST = 100.0
"""Largest cost to go that the network distinguishes [m]."""


@dataclass(frozen=True)
class FrontierConfig:
    """Shape of the network.

    Attributes:
        widths: channels of each stage; the resolution halves in each.
        hidden: width of the hidden layers.
    """

    widths: tuple[int, ...] = (16, 32, 48, 64)
    hidden: int = 96

    @classmethod
    def of(cls, fields: dict[str, Any]) -> FrontierConfig:
        """Make a configuration from the fields in a file's header.

        Raises:
            ValueError: if a width is no positive integer up to 1024, or there is none.
            KeyError: if a field is missing.
            TypeError: if `widths` is no list.
        """
        widths, hidden = tuple(fields["widths"]), fields["hidden"]
        numbers = (*widths, hidden)
        if not widths or not all(type(n) is int and 0 < n <= 1024 for n in numbers):
            raise ValueError(f"widths {widths} and hidden {hidden} must be positive integers")
        return cls(widths, hidden)


class FrontierNet(nn.Module):
    """The network of frontiers.

    Args:
        config: shape of the network; None: the default.
    """

    ARCHITECTURES: tuple[str, ...] = ("frontier-1",)
    """Name in files of weights; the number changes when the meaning of weights does."""
    CONFIG = FrontierConfig

    def __init__(self, config: FrontierConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or FrontierConfig()
        stages: list[nn.Module] = []
        channels = 5
        for number, width in enumerate(config.widths):
            side = 5 if number == 0 else 3
            stages += [nn.Conv2d(channels, width, side, 2, side // 2), nn.ReLU()]
            # The finest stages have no second convolution: it would take most of the time.
            if number > 1:
                stages += [nn.Conv2d(width, width, 3, 1, 1), nn.ReLU()]
            channels = width
        self.features = nn.Sequential(*stages)
        hidden = config.hidden
        self.head = nn.Sequential(
            nn.Linear(3 * channels + 3, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 3),
        )

    @property
    def architecture(self) -> str:
        """Name in files of weights."""
        return self.ARCHITECTURES[0]

    def forward(
        self, pictures: Tensor, goals: Tensor, to_go: Tensor, sizes: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return logits of leading to the goal, ways and ways back [m], (B,) each.

        Args:
            pictures: shares in [0, 1] of free, of occupied and of the frontier, (B, 3, SIDE, SIDE).
            goals: x, y of the goal from the picture's middle, (B, 2) [m].
            to_go: cost to go if unobserved space is free, (B,) [m].
            sizes: number of cells of the frontier, (B,).
        """
        axis = (torch.arange(SIDE, device=pictures.device) + 0.5 - SIDE / 2) * CELL
        away = torch.hypot(
            axis[None, None, :] - goals[:, 0, None, None],
            axis[None, :, None] - goals[:, 1, None, None],
        )
        straight = torch.hypot(goals[:, 0], goals[:, 1])
        # How much nearer to the goal each cell is than the frontier, and where the goal itself is.
        nearer = (away - straight[:, None, None]) / SCALE
        at_goal = torch.exp(-0.5 * away)
        features = self.features(torch.cat([pictures, torch.stack([nearer, at_goal], 1)], dim=1))
        middle = features.shape[-1] // 2
        numbers = [straight / 20.0, torch.log1p(sizes) / 3.0, to_go.clamp(max=FARTHEST) / 30.0]
        seen = [
            features.mean(dim=(2, 3)),
            features.amax(dim=(2, 3)),
            features[:, :, middle - 1 : middle + 1, middle - 1 : middle + 1].mean(dim=(2, 3)),
            torch.stack(numbers, dim=1),
        ]
        leads, way, back = self.head(torch.cat(seen, dim=1)).unbind(dim=1)
        return leads, straight + SCALE * F.softplus(way), SCALE * F.softplus(back)
