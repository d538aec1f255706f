"""The learned predictor: a compact network, trained on generated buildings, with its weights."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from torch import Tensor

from predictor.compact_net import FREE, OCCUPIED, ROOM
from predictor.grid import Grid
from predictor.prediction import Prediction
from predictor.samples import quarters
from predictor.targets import question, widened
from predictor.weights import load_weights

SHIPPED = Path(__file__).with_name("compact.safetensors")
"""The weights that come with the package; their card lies beside them."""
RESOLUTION = 0.05
"""Of the maps that the network was trained on [m]; others are resampled to it."""
SUREST = 0.9999
"""Most confidence in a cell not seen: a planner takes 1 for certain, which no network is."""

Index = slice | NDArray[np.intp]


class Compact:
    """Predicts what a network has learned of buildings.

    The probabilities are those of single cells. A car needs room: the confidence is 1 less the
    probability that a cell is free, but in no free square as wide as the car. So where p_free is
    high, confidence * p_free, which the planner relies upon, is the probability of such a square.

    Args:
        weights: a .safetensors file; the shipped one by default.

    Raises:
        WeightsError: if the file does not hold weights of this network.
    """

    def __init__(self, weights: Path = SHIPPED) -> None:
        net, self.facts = load_weights(weights)
        self.net = net.folded()

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Predict the rest of a window.

        Raises:
            ValueError: if the window is empty or the pose not finite.
        """
        if known.cells.size == 0:
            raise ValueError("the window is empty: there is no cell to predict")
        if not np.isfinite(pose).all():
            raise ValueError(f"pose is {pose}, it must be finite")
        turns = quarters(float(pose[2]))
        seen, rows, cols = _resampled(known)
        outputs = self._outputs(np.rot90(seen, turns))
        outputs = np.rot90(outputs, -turns, axes=(1, 2))[:, rows][:, :, cols].copy()
        p_free, p_occupied, confidence = outputs
        if known.unknown.all():
            # Whatever the network says of a map in which nothing was seen, it has no reason to.
            confidence[:] = 0.0
        for values, observed in ((p_free, known.free), (p_occupied, known.occupied),
                                 (confidence, True)):  # fmt: skip
            np.copyto(values, observed, where=~known.unknown)
        return Prediction(known.frame, p_free, p_occupied, confidence)

    def _outputs(self, seen: NDArray[np.int8]) -> NDArray[np.float32]:
        """p_free, p_occupied, confidence (3, rows, columns) of a map that looks along +x."""
        rows, cols = seen.shape
        multiple = self.net.config.multiple
        padding = [((-n % multiple) // 2, -n % multiple - (-n % multiple) // 2) for n in seen.shape]
        padded = np.pad(seen, padding, constant_values=2)
        with torch.inference_mode():
            codes = torch.from_numpy(np.ascontiguousarray(padded))[None]
            known = torch.stack([codes == 0, codes == 1], dim=1).float()
            logits = self.net(known.contiguous(memory_format=torch.channels_last))
            classes = torch.softmax(logits[:, :ROOM], dim=1)[0]
            room = _likeliest(torch.sigmoid(logits[:, ROOM]), codes)[0]
            confidence = (1.0 - classes[FREE] + room).clamp(max=SUREST)
        top, left = padding[0][0], padding[1][0]
        out = torch.stack([classes[FREE], classes[OCCUPIED], confidence]).numpy()
        return np.asarray(out[:, top : top + rows, left : left + cols])


def _likeliest(room: Tensor, codes: Tensor) -> Tensor:
    """Probability of the likeliest free square around each cell not seen, (B, H, W).

    Args:
        room: probability that the square around a cell is free, (B, H, W).
        codes: what was seen there, (B, H, W).
    """
    _, asked = question(codes)
    return widened(torch.where(asked, room, 0.0))


def _resampled(known: Grid) -> tuple[NDArray[np.int8], Index, Index]:
    """A map at the network's resolution, and for each row and column of the map its own there.

    Its cells are 0 free, 1 occupied, 2 not seen.
    """
    # In the order in which they win where several cells make one: free, not seen, occupied.
    rank = known.unknown + np.int8(2) * known.occupied
    rows: Index = slice(None)
    cols: Index = slice(None)
    ratio = RESOLUTION / known.frame.resolution
    if abs(ratio - 1.0) > 1e-6:
        rows, cols = (((np.arange(n) + 0.5) / ratio).astype(np.intp) for n in rank.shape)
        there = [((np.arange(back[-1] + 1) + 0.5) * ratio).astype(np.intp) for back in (rows, cols)]
        rank = maximum_filter(rank, max(1, math.ceil(ratio - 1e-6)), mode="nearest")
        rank = rank[np.minimum(there[0], rank.shape[0] - 1)[:, None],
                    np.minimum(there[1], rank.shape[1] - 1)]  # fmt: skip
    return np.asarray(-rank % 3, dtype=np.int8), rows, cols
