"""The networks of the paper as predictors: from a map to an image, from greys to probabilities."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from foresee.mapping.conventions import CROP_SIDE
from foresee.mapping.grid import Grid, GridFrame, paste
from foresee.prediction import Prediction, View, with_observed
from predictor.data.samples import quarters
from predictor.data.squares import encode_cells
from predictor.networks.grey_image import grey_level, map_images, pixels_at_cells
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.runtime import Runner, runner
from predictor.weights import load_weights, modified

SUREST = 0.9999
"""Confidence inside the predicted square, just below certainty: these networks give no measure of
how cells depend on each other, by which it could be lowered."""


class ImagePredictor:
    """A predictor that runs a network of the paper.

    It predicts the square around the robot that the network was trained for, with the confidence
    SUREST. Outside, and if nothing was observed, the confidence is 0.

    Args:
        weights: a .safetensors file that `predictor.train` has written.
        runtime: runtime of the network, see `predictor.runtime`; None: the fastest installed.

    Raises:
        WeightsError: if the file does not hold weights of one of these networks.
        ValueError: if the runtime is not installed.
    """

    context_side = 0.0

    def __init__(self, weights: Path, runtime: str | None = None) -> None:
        self._run, self.config, self._chances, self.facts = _loaded(
            weights, modified(weights), runtime
        )

    def predict(self, view: View) -> Prediction:
        """Predict the unobserved part of a window."""
        return believed(view.known, self.grey_layers(view))

    @property
    def given(self) -> str:
        """Input of the network: one of `predictor.networks.image_config.GIVEN`."""
        return self.config.given

    def image(self, view: View) -> NDArray[np.float32]:
        """Return the greys of the network in [-1, 1] on the map's frame; 0 outside its square."""
        square, grey = self._grey(view)
        return paste(square, grey, view.known.frame, np.float32(0.0))

    def grey_layers(self, view: View) -> NDArray[np.float32]:
        """Return the greys of the network and their meaning on the frame of `known`.

        Returns:
            Grey in [-1, 1], p_free, p_occupied, and 1 inside the predicted square; all are 0
            outside of it: (4, rows, columns).
        """
        square, grey = self._grey(view)
        layers = (grey, *self._chances[:, grey_level(grey)], np.ones_like(grey))
        frame = view.known.frame
        return np.stack([paste(square, layer, frame, np.float32(0.0)) for layer in layers])

    def _grey(self, view: View) -> tuple[GridFrame, NDArray[np.float32]]:
        """Return the predicted square, and the greys of the network there."""
        known, (x, y, yaw) = view.known, (float(value) for value in view.pose)
        square = known.frame.square(x, y, CROP_SIDE * self.config.expansion)
        if self.config.given == "crop":
            known = known.crop(known.frame.square(x, y, CROP_SIDE))
        given = known.crop(square)
        turns = quarters(yaw) if self.config.turned else 0
        image = map_images(np.rot90(encode_cells(given.cells), turns), self.config.side)
        grey = pixels_at_cells(self._run(image[None])[0], square.shape[0])
        return square, np.rot90(grey, -turns)


def believed(known: Grid, layers: NDArray[np.float32]) -> Prediction:
    """Make a prediction of the layers of `ImagePredictor.grey_layers`; observed cells are kept.

    Args:
        known: map of all that was observed.
        layers: (4, rows, columns).
    """
    _, p_free, p_occupied, said = layers
    sure = said * np.float32(0.0 if known.unknown.all() else SUREST)
    return with_observed(known, p_free, p_occupied, sure)


class _RuntimeNet(nn.Module):
    """The network as one module for a runtime, with whole greys as input."""

    def __init__(self, net: GreyNet) -> None:
        super().__init__()
        self.net = net.net

    def forward(self, images: Tensor) -> Tensor:
        """Return images (B, side, side) in [-1, 1] for images of the same shape."""
        out: Tensor = self.net(images[:, None].float())[:, 0]
        return out


@lru_cache(maxsize=4)
def _loaded(
    weights: Path, changed: int, runtime: str | None
) -> tuple[Runner, ImageConfig, NDArray[np.float32], dict[str, Any]]:
    """Return a function that runs the network, its configuration, meaning of greys, and facts."""
    # Cached, since each drive makes a predictor of its own.
    net, facts = load_weights(weights, GreyNet)
    run, runs_on = runner(_RuntimeNet(net).eval(), runtime, (net.config.side, net.config.side))
    return run, net.config, net.chances.numpy(), facts | {"runtime": runs_on}
