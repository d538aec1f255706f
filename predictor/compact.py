"""The learned predictor: a compact network trained on generated buildings."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from foresee.mapping.context import CELLS, SIDE, coarse_context
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import Grid
from foresee.mapping.resampling import resampled
from foresee.prediction import Prediction, View, with_observed
from predictor.data.samples import quarters
from predictor.data.squares import encode_cells
from predictor.networks.compact_net import (
    FREE,
    OCCUPIED,
    ROOM,
    CompactConfig,
    CompactNet,
    room_masks,
    widened,
)
from predictor.runtime import Runner, runner
from predictor.weights import load_weights, modified

SHIPPED, LOGS, PAPER = (
    Path(__file__).with_name(f"{name}.safetensors")
    for name in ("compact", "compact-logs", "compact-paper")
)
"""Files of weights in this package: for driving, fine-tuned on simulated robot logs, and fine-tuned
on buildings as in the paper alone. The pages in docs/reference/cards describe them."""
SUREST = 0.9999
"""Highest confidence in an unobserved cell: a planner would take 1 as certain."""


class Compact:
    """A predictor that runs the compact network.

    The probabilities are those of single cells. The confidence is 1 minus the probability that a
    cell is free but not part of a free square as wide as the car. Where p_free is high,
    confidence * p_free, which the planner uses, is therefore the probability of such a square.

    The doubt depends on the kind of building, see `CompactNet.doubt`; it is 1 for a network without
    a layer for kinds.

    Args:
        weights: a .safetensors file; the shipped one by default.
        runtime: runtime of the network, see `predictor.runtime`; None: the fastest installed.

    Raises:
        WeightsError: if the file does not hold weights of this network.
        ValueError: if the runtime is not installed.

    Attributes:
        context_side: side of the map that the network uses besides `known` [m]; 0: it uses none.
    """

    def __init__(self, weights: Path = SHIPPED, runtime: str | None = None) -> None:
        self._run, self._config, self.facts = _loaded(weights, modified(weights), runtime)
        self.weights = weights
        self.context_side = SIDE if self._config.context else 0.0

    def predict(self, view: View) -> Prediction:
        """Predict the unobserved part of a window of any size."""
        known, turns = view.known, quarters(float(view.pose[2]))
        # The network was trained on maps of this resolution.
        fine, rows, cols = resampled(known, RESOLUTION)
        codes = encode_cells(fine.cells).astype(np.int8)
        inputs: list[NDArray[Any]] = [np.rot90(codes, turns)]
        if self.context_side:
            inputs.append(np.rot90(coarse_context(_context(view.around)), turns, axes=(1, 2)))
        outputs = self._outputs(*inputs)
        outputs = np.rot90(outputs, -turns, axes=(1, 2))[:, rows][:, :, cols].copy()
        p_free, p_occupied, confidence, doubt = outputs
        if known.unknown.all():
            # With nothing observed, the network has no evidence for its answer.
            confidence[:] = 0.0
        return with_observed(known, p_free, p_occupied, confidence, doubt=float(doubt.max()))

    def _outputs(
        self, codes: NDArray[Any], context: NDArray[Any] | None = None
    ) -> NDArray[np.float32]:
        """Return p_free, p_occupied, confidence and doubt of a map facing +x, (4, rows, columns).

        The doubt is the same in all cells.
        """
        rows, cols = codes.shape
        over = [-n % self._config.multiple for n in codes.shape]
        padded = np.pad(codes, [(n // 2, n - n // 2) for n in over], constant_values=2)
        top, left = over[0] // 2, over[1] // 2
        # The percentages are at most 100, so they fit into int8.
        inputs = [padded] if context is None else [padded, context.astype(np.int8)]
        answers = self._run(*(np.ascontiguousarray(array)[None] for array in inputs))
        return answers[0, :, top : top + rows, left : left + cols]


def of_logs() -> Compact:
    """Return a predictor of what a robot's log will map, where most rooms behind doors are missing.

    It is not meant for driving; use `Compact()` for that, which predicts the building.
    """
    return Compact(LOGS)


def of_paper() -> Compact:
    """Return a predictor of buildings as in the paper, with no rooms behind walls.

    Use `Compact()` to drive in other buildings.
    """
    return Compact(PAPER)


class _Answers(nn.Module):
    """The network with everything around it, as one module for a runtime."""

    def __init__(self, net: CompactNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, codes: Tensor, context: Tensor | None = None) -> Tensor:
        """Return p_free, p_occupied, confidence and doubt, (B, 4, H, W).

        The doubt is the same in all cells of a map.

        Args:
            codes: codes of what was observed, (B, H, W).
            context: percentages of `coarse_context`, (B, 2, CELLS, CELLS).
        """
        known = torch.stack([codes == 0, codes == 1], dim=1).float()
        shares = None if context is None else 0.01 * context.float()
        logits, kinds = self.net.all_logits(
            known.contiguous(memory_format=torch.channels_last), shares
        )
        classes = torch.softmax(logits[:, :ROOM], dim=1)
        # The highest probability of a free square that holds each cell.
        _, asked = room_masks(codes)
        room = widened(torch.where(asked, torch.sigmoid(logits[:, ROOM]), 0.0))
        confidence = (1.0 - classes[:, FREE] + room).clamp(max=SUREST)
        if kinds is None:
            doubt = torch.ones_like(confidence)
        else:
            doubt = self.net.doubt(kinds)[:, None, None].expand_as(confidence)
        return torch.stack([classes[:, FREE], classes[:, OCCUPIED], confidence, doubt], dim=1)


@lru_cache(maxsize=4)
def _loaded(
    weights: Path, changed: int, runtime: str | None
) -> tuple[Runner, CompactConfig, dict[str, Any]]:
    """Return a function that runs the network, the network's shape, and its facts."""
    # Cached, since each drive makes a predictor of its own.
    net, facts = load_weights(weights, CompactNet)
    shapes = [(80, 120), (2, CELLS, CELLS)][: 1 + bool(net.config.context)]
    run, runs_on = runner(_Answers(net.folded()), runtime, *shapes)
    return run, net.config, facts | {"runtime": runs_on}


def _context(around: Grid) -> Grid:
    """Return the square of `SIDE` in the middle of a map of any size."""
    rows, cols = around.frame.shape
    middle = around.frame.centre(0.5 * (rows - 1), 0.5 * (cols - 1))
    square = around.frame.square(*middle, SIDE)
    return around if square.shape == (rows, cols) else around.crop(square)
