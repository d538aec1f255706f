"""The learned predictor of frontiers: a network trained on generated buildings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from foresee.frontiers import FrontierValues
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.frontier import Frontier
from foresee.mapping.grid import Grid
from foresee.mapping.resampling import resampled
from predictor.data.frontier_samples import frontier_pictures
from predictor.networks.frontier_net import FARTHEST, FrontierNet
from predictor.weights import load_weights, modified

SHIPPED = Path(__file__).with_name("frontiers.safetensors")
"""File of the weights in this package; docs/reference/cards/frontiers.md describes it."""


class LearnedFrontiers:
    """A predictor of frontiers that runs the network `FrontierNet`.

    Args:
        weights: a .safetensors file; the shipped one by default.

    Raises:
        WeightsError: if the file does not hold weights of this network.

    Attributes:
        facts: facts of the training of the weights.
    """

    def __init__(self, weights: Path = SHIPPED) -> None:
        self._net, self.facts = _loaded(weights, modified(weights))
        self.weights = weights

    def __reduce__(self) -> tuple[type[LearnedFrontiers], tuple[Path]]:
        # A search in another process is sent the path alone, and loads the weights once.
        return LearnedFrontiers, (self.weights,)

    def values(
        self, known: Grid, goal: tuple[float, float], frontiers: Sequence[Frontier]
    ) -> FrontierValues:
        """Predict where frontiers lead, see `foresee.frontiers`."""
        # The network was trained on maps of this resolution.
        fine, _, _ = resampled(known, RESOLUTION)
        pictures, middles = frontier_pictures(fine, frontiers)
        to_go = np.minimum([frontier.to_go for frontier in frontiers], FARTHEST)
        sizes = [len(frontier.points) for frontier in frontiers]
        with torch.inference_mode():
            leads, way, back = self._net(
                torch.from_numpy(pictures).float() / 100.0,
                torch.tensor(np.array(goal) - middles, dtype=torch.float32),
                torch.tensor(to_go, dtype=torch.float32),
                torch.tensor(sizes, dtype=torch.float32),
            )
            numbers = torch.stack([torch.sigmoid(leads), way, back]).double().numpy()
        return FrontierValues(*numbers)


@lru_cache(maxsize=2)
def _loaded(weights: Path, changed: int) -> tuple[FrontierNet, dict[str, Any]]:
    # Cached, since each drive makes a predictor of its own.
    return load_weights(weights, FrontierNet)
