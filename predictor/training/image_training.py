"""The training of the paper's networks on frames, and the calibration of their greys at its end."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from foresee.infra.errors import one_line
from foresee.infra.plain_json import read_object
from predictor.data.frames import Frames, FramesError
from predictor.data.packed_samples import SamplesError
from predictor.data.samples import PLANNED, RECIPE, Samples
from predictor.data.splits import check_apart
from predictor.networks.grey_net import GreyNet
from predictor.networks.image_config import ImageConfig
from predictor.runtime import fastest_device
from predictor.training.checkpoint import TrainError, is_trained
from predictor.training.image_learner import Adversary, Learner
from predictor.training.image_validation import batch_images, fit, images_alike
from predictor.training.optimisation import deterministic
from predictor.training.settings import ImageTraining, described
from predictor.training.trainer import Trainer
from predictor.weights import save_weights

NOTES = 20
"""Smallest number of validations in a training; there is also at least one in each epoch."""


class ImageTrainer(Trainer):
    """A training of one of the paper's networks.

    Args:
        config: settings of the network.
        training: settings of the training.
        train: training frames.
        validation: validation frames, on which the greys are also calibrated.
        out: folder of checkpoint, log, curve and weights.

    Raises:
        TrainError: if the folder holds another training.
        SplitError: if a building is in both splits.
    """

    def __init__(
        self,
        config: ImageConfig,
        training: ImageTraining,
        train: Frames | Samples,
        validation: Frames | Samples,
        out: Path,
    ) -> None:
        self.config, self.training = config, training
        self.train, self.validation = train, validation
        check_apart({"train": train.worlds, "validation": validation.worlds})
        steps = max(1, round(training.epochs * len(self.train) / training.batch))
        deterministic(training.seed)
        device = fastest_device()
        net = GreyNet(config).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.learner = (Adversary if config.arch == "gan" else Learner)(net, training)
        self.LOSSES = self.learner.LOSSES
        self.CURVES = (("l1", "validation_l1"), ("ssim",))
        if len(self.LOSSES) > 1:
            self.CURVES += (self.LOSSES[1:],)
        facts = described(config, training, (train.digest, validation.digest)) | {
            # Device, threads and processes (always 1) decide the rounding of sums.
            "arithmetic": [device.type, torch.get_num_threads(), 1],
            "frames": len(self.train),
            "steps": steps,
            "worlds": sorted(train.worlds),
            "validation_worlds": sorted(validation.worlds),
        }
        an_epoch = math.ceil(len(self.train) / training.batch)
        note_every = max(1, min(an_epoch, steps // NOTES))
        super().__init__(out / f"{config.arch}.safetensors", facts, steps, note_every, device)

    def _state(self) -> dict[str, Any]:
        return self.learner.state()

    def _load(self, state: dict[str, Any]) -> None:
        self.learner.load(state)

    def _batch(self, step: int) -> tuple[Tensor, ...]:
        first = step * self.training.batch
        places = [divmod(first + i, len(self.train)) for i in range(self.training.batch)]
        chosen = [int(self._order(epoch)[place]) for epoch, place in places]
        squares = [self.train.square(index, self.config.expansion) for index in chosen]
        given, wanted = batch_images(squares, self.config)
        return torch.from_numpy(given), torch.from_numpy(wanted)

    @lru_cache(maxsize=2)  # noqa: B019  It lives as long as the training.
    def _order(self, epoch: int) -> NDArray[np.intp]:
        """Return the order of the frames in an epoch."""
        rng = np.random.default_rng([self.training.seed, epoch])
        return rng.permutation(len(self.train))

    def _learn(self, *batch: Tensor) -> list[float]:
        given, wanted = (images.to(self.device).float() for images in batch)
        key = [self.training.seed, self.step, 0]
        torch.manual_seed(int(np.random.SeedSequence(key).generate_state(1)[0]))
        self.learner.net.train()
        rate = self.training.rate * min(1.0, 2.0 - 2.0 * self.step / self.steps)
        losses: list[float] = self.learner.learn(given, wanted, rate).tolist()
        return losses

    def _measures(self) -> dict[str, float]:
        epoch = self.step * self.training.batch / len(self.train)
        return {"epoch": round(epoch, 3), **images_alike(self.learner.net, self.validation)}

    def _export(self, facts: dict[str, Any]) -> None:
        measures = fit(self.learner.net, self.validation)
        facts |= {"seconds": self.seconds, "log": self.log, "validation": measures}
        save_weights(self.weights, self.learner.net, facts)


def train_images(
    config: ImageConfig,
    training: ImageTraining,
    data: Path,
    out: Path,
    threads: int,
    end: float = math.inf,
) -> Path:
    """Train a network unless its weights exist, and return the path of its weights.

    Args:
        config: settings of the network; `turned` is replaced by what the data need.
        training: settings of the training.
        data: folder that `predictor.dataset` or `predictor.drives` has made.
        out: folder of checkpoint, log, curve and weights.
        threads: number of threads of this process.
        end: see `Trainer.run`.

    Raises:
        TrainError: if the data cannot be read, or the folder holds another training.
        Stopped: if the time was over before the last step of the training.
    """
    torch.set_num_threads(threads)
    of_drives = (data / RECIPE).exists()
    train, validation = (_load_samples if of_drives else load_frames)(data)
    config = dataclasses.replace(config, turned=of_drives)
    weights = out / f"{config.arch}.safetensors"
    if is_trained(weights, described(config, training, (train.digest, validation.digest))):
        return weights
    return ImageTrainer(config, training, train, validation, out).run(end)


def load_frames(data: Path) -> list[Frames]:
    """Read the frames of a data set to train on, and those to validate on.

    Raises:
        TrainError: if there are none that can be read.
    """
    try:
        return [Frames.load(data, split) for split in ("train", "validation")]
    except FramesError as error:
        raise TrainError(f"--data: {error}") from None


def _load_samples(data: Path) -> list[Samples]:
    """Read the samples of drives to train on, and those to validate on."""
    planned: dict[str, Any] = {}
    try:
        if (data / PLANNED).exists():
            planned = read_object(data / PLANNED)
        return [Samples.load(data / split, planned.get(split)) for split in ("train", "validation")]
    except (SamplesError, OSError, ValueError, TypeError) as error:
        raise TrainError(f"--data: {one_line(error)}") from None
