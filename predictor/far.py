"""The far predictor: what lies up to 20 m ahead, in coarse cells, for routes."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from foresee.mapping.context import FAR_CELL, FINER
from foresee.mapping.resampling import resampled
from foresee.prediction import Prediction, View, with_observed
from predictor.data.squares import encode_cells
from predictor.networks.far_net import FarNet
from predictor.runtime import Runner, runner
from predictor.weights import load_weights, modified

SHIPPED = Path(__file__).with_name("far.safetensors")
"""File of the weights in this package; docs/reference/cards/far.md describes it."""


class Far:
    """A predictor that runs the far network, for the argument `far` of `planner.navigator`.

    Args:
        weights: a .safetensors file; the shipped one by default.
        runtime: runtime of the network, see `predictor.runtime`; None: the fastest installed.

    Raises:
        WeightsError: if the file does not hold weights of this network.
        ValueError: if the runtime is not installed.

    Attributes:
        context_side: it needs no larger map than the square that it predicts.
        facts: facts of the training of the weights.
    """

    context_side = 0.0

    def __init__(self, weights: Path = SHIPPED, runtime: str | None = None) -> None:
        self._run, self._multiple, self.facts = _loaded(weights, modified(weights), runtime)
        self.weights, self._runtime = weights, runtime

    def __reduce__(self) -> tuple[type[Far], tuple[Path, str | None]]:
        # Compiled networks cannot be pickled; another process loads the weights once.
        return Far, (self.weights, self._runtime)

    def predict(self, view: View) -> Prediction:
        """Predict which cells of a map are free as a whole; all others count as occupied."""
        coarse, rows, cols = resampled(view.known, FAR_CELL)
        codes = encode_cells(coarse.cells).astype(np.int8)
        over = [(0, -n % self._multiple) for n in codes.shape]
        padded = np.ascontiguousarray(np.pad(codes, over, constant_values=2)[None])
        p_free = self._run(padded)[0][rows][:, cols]
        return with_observed(view.known, p_free, 1.0 - p_free, np.ones_like(p_free))


class _Answer(nn.Module):
    """The network with everything around it, as one module for a runtime."""

    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = net

    def forward(self, codes: Tensor) -> Tensor:
        """Return p_free (B, H, W) for codes (B, H, W) of what was observed."""
        known = torch.stack([codes == 0, codes == 1], dim=1).float()
        logits = self.net(known.contiguous(memory_format=torch.channels_last))
        return torch.sigmoid(logits[:, 0])


@lru_cache(maxsize=2)
def _loaded(weights: Path, changed: int, runtime: str | None) -> tuple[Runner, int, dict[str, Any]]:
    """Return a function that runs the network, what its sides are multiples of, and its facts."""
    # Cached, since each drive makes a predictor of its own.
    net, facts = load_weights(weights, FarNet)
    run, runs_on = runner(_Answer(net.folded()), runtime, (FINER, FINER))
    return run, net.config.multiple, facts | {"runtime": runs_on}
