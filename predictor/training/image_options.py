"""Options of the paper's networks and of their training."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from foresee.infra.options import Options, given, option
from predictor.networks.image_config import GIVEN, SIDES, ImageConfig
from predictor.training.checkpoint import TrainError
from predictor.training.settings import PRESETS, ImageTraining

PAPER, SHORT = PRESETS["paper"], PRESETS["short"]


@dataclass(frozen=True)
class ImageOptions(Options):
    """Options of the paper's networks; for None the preset's value is used."""

    preset: str | None = option(
        None,
        "size and schedule: that of the paper, or short, for 2 CPU cores; the other options change "
        "single values (default: paper)",
        choices=tuple(PRESETS),
    )
    given: str | None = option(
        None,
        "what the network is given: the 5 m crop alone, or all that was observed inside the "
        "predicted square (default: crop)",
        choices=GIVEN,
    )
    width: float | None = option(
        None,
        f"factor of the number of channels (paper: {PAPER.width:g}; short: {SHORT.width:g})",
        "F",
    )
    side: int | None = option(
        None,
        f"side of the images [pixels] (paper: {PAPER.side}; short: {SHORT.side})",
        choices=SIDES,
    )
    epochs: float | None = option(
        None,
        f"number of passes over the frames (paper: {PAPER.training.epochs:g}; short: "
        f"{SHORT.training.epochs:g})",
        "E",
    )
    sigma: float | None = option(
        None,
        f"standard deviation of the initial weights (paper: {PAPER.training.sigma:g}; short: "
        f"{SHORT.training.sigma:g}, as in pix2pix)",
        "S",
    )
    dropout: float | None = option(
        None,
        "dropout rate, in the first three decoder layers of a U-Net and in the blocks of a ResNet "
        f"(paper and short: {PAPER.training.dropout:g})",
        "P",
    )
    bf16: bool = option(False, "compute in bfloat16 where torch's autocast allows it")

    def configured(
        self, arch: str, expansion: float, batch: int | None, rate: float | None, seed: int | None
    ) -> tuple[ImageConfig, ImageTraining]:
        """Return the settings of a network and of its training: the preset with the given values.

        Args:
            arch: name of the architecture.
            expansion: width of the predicted square divided by that of the crop.
            batch: frames per step; None: that of the preset.
            rate: learning rate; None: that of the preset.
            seed: seed of the training; None: that of the preset.

        Raises:
            TrainError: if a value cannot be used.
        """
        preset = PRESETS[self.preset or "paper"]
        values = given(
            epochs=self.epochs,
            batch=batch,
            rate=rate,
            sigma=self.sigma,
            dropout=self.dropout,
            seed=seed,
        )
        network = given(given=self.given, width=self.width, side=self.side)
        network = {"width": preset.width, "side": preset.side} | network
        try:
            training = dataclasses.replace(preset.training, **values, brief=self.bf16)
            # With a batch of one, batch normalisation normalises over the image.
            over = "image" if training.batch == 1 else "batch"
            return ImageConfig(arch, expansion, over=over, **network), training
        except ValueError as error:
            raise TrainError(f"--{error}") from None
