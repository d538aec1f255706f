"""The training of the paper's networks: frames in; weights, and what their greys mean, out.

A checkpoint holds everything that decides what comes next, and what a step does depends on its
number and the seed alone, dropout too: a training that was killed and started again by the same
command ends as if it had not been.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from predictor.data.frames import Frames, FramesError
from predictor.data.sample_frames import SampleFrames
from predictor.data.samples import RECIPE, Samples, SamplesError
from predictor.infra.atomic_file import clear, write_whole
from predictor.infra.environment import commit
from predictor.networks.image_config import ImageConfig, ImageTraining, described
from predictor.networks.image_net import ImageNet
from predictor.training.checkpoint import (
    TrainError,
    is_trained,
    read_checkpoint,
    write_checkpoint,
)
from predictor.training.curve import draw_curve
from predictor.training.group import Group
from predictor.training.image_validation import fit, images_alike
from predictor.training.learner import Adversary, Learner
from predictor.training.pairs import Pairs
from predictor.weights import save_weights

if TYPE_CHECKING:
    from threading import Event


NOTES = 20
"""Entries of the log, at least; and at least one an epoch."""
SAVE_EVERY = 60.0
"""Between two checkpoints [s]; one follows each entry of the log too."""


class Stopped(Exception):
    """A training was told to stop, and can be taken up again."""


class ImageTrainer:
    """A training that can be left and taken up again, by one process or several.

    Args:
        config: the network.
        training: how it learns.
        train: frames to learn from.
        validation: frames to measure on, and to fit the meaning of greys on.
        out: folder of checkpoint, log and weights; all processes must see it.
        group: the processes that train together.

    Raises:
        TrainError: if the folder holds another training, a building is in both splits, or the
            batch cannot be shared.
    """

    def __init__(
        self,
        config: ImageConfig,
        training: ImageTraining,
        train: Frames | SampleFrames,
        validation: Frames | SampleFrames,
        out: Path,
        group: Group,
    ) -> None:
        self.config, self.training, self.group, self.out = config, training, group, out
        self.train, self.validation = Pairs(train, config), Pairs(validation, config)
        if training.batch % group.size:
            raise TrainError(f"a batch of {training.batch} cannot be shared by {group.size} "
                             "processes: choose a multiple by --batch")  # fmt: skip
        both = train.worlds & validation.worlds
        if both:
            raise TrainError(f"{len(both)} buildings are both in train and in validation")
        self.steps = max(1, round(training.epochs * len(self.train) / training.batch))
        # Where one sum in another order would make another network.
        torch.backends.cudnn.deterministic = True
        torch.manual_seed(training.seed)
        net = ImageNet(config).to(group.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.learner = (Adversary if config.arch == "gan" else Learner)(net, training, group)
        self.step, self.seconds = 0, 0.0
        self.log: list[dict[str, float]] = []
        self.losses: list[list[float]] = []
        """Of the steps since the last entry of the log."""
        self.commits: set[str] = set()
        """Of the code that made the steps."""
        if group.first:
            out.mkdir(parents=True, exist_ok=True)
            clear(out)
        self._facts: dict[str, Any] = {
            **described(config, training, (train.digest, validation.digest)),
            # What else decides the last bits of the sums.
            "arithmetic": [group.device.type, torch.get_num_threads(), group.size],
            "frames": len(self.train),
            "steps": self.steps,
            "worlds": sorted(train.worlds),
            "validation_worlds": sorted(validation.worlds),
        }
        state = read_checkpoint(self.checkpoint, self._facts, group.device)
        if state is not None:
            self.learner.load(state["learner"])
            self.step, self.seconds = state["step"], state["seconds"]
            self.log, self.losses = state["log"], state["losses"]
            # Checkpoints did not name them at first.
            self.commits = set(state.get("commits", ["unknown"]))

    @property
    def checkpoint(self) -> Path:
        """Where the state is kept."""
        return self.out / "checkpoint.pt"

    @property
    def weights(self) -> Path:
        """Where the weights go in the end."""
        return self.out / f"{self.config.arch}.safetensors"

    def run(self, stopping: Event | None = None) -> Path:
        """Train to the end, with a progress bar, and export the weights.

        Args:
            stopping: once it is set, the next step is the last, and a checkpoint is written.

        Raises:
            Stopped: if it came to that.
        """
        from tqdm import tqdm

        code = commit() or "no checkout"
        an_epoch = math.ceil(len(self.train) / self.training.batch)
        note_every = max(1, min(an_epoch, self.steps // NOTES))
        saved = begun = time.monotonic()
        before = self.seconds
        with (
            tqdm(total=self.steps, initial=self.step, unit="step", smoothing=0.05, mininterval=0.5,
                 disable=not self.group.first) as bar,
            ThreadPoolExecutor(1) as ahead,
        ):  # fmt: skip
            for given, wanted in self._batches(ahead):
                self.losses.append(self._learn(given, wanted))
                self.step += 1
                self.commits.add(code)
                bar.update()
                last = self.step == self.steps
                noted = self.step % note_every == 0 or last
                if noted:
                    if self.group.first:
                        self._note()
                        bar.set_postfix_str(told(self.log[-1]))
                    self.losses = []
                stop = stopping is not None and stopping.is_set() and not last
                due = time.monotonic() - saved > SAVE_EVERY or noted or stop
                if self.group.first and due:
                    self.seconds = before + time.monotonic() - begun
                    self.save()
                    saved = time.monotonic()
                if stop:
                    raise Stopped
        if self.group.first:
            self.export()
        return self.weights

    def save(self) -> None:
        """Write the checkpoint, whole or not at all."""
        state = {
            "facts": self._facts, "step": self.step, "log": self.log, "losses": self.losses,
            "seconds": self.seconds, "commits": sorted(self.commits),
            "learner": self.learner.state(),
        }  # fmt: skip
        write_checkpoint(self.checkpoint, state)

    def export(self) -> None:
        """Fit what the greys mean, and write weights and curve."""
        measures = fit(self.learner.net, self.validation)
        facts = self._facts | {
            "commit": " ".join(sorted(self.commits)), "seconds": self.seconds, "log": self.log,
            "validation": measures,
        }  # fmt: skip
        panels = (("l1", "validation_l1"), ("ssim",), self.learner.LOSSES[1:])
        draw_curve(self.log, self.out / "curve.png", tuple(filter(None, panels)))
        save_weights(self.weights, self.learner.net, facts)

    def _batches(self, ahead: ThreadPoolExecutor) -> Iterator[tuple[Tensor, Tensor]]:
        """What each step still to be made learns from, made ready while another is learnt from."""
        coming = ahead.submit(self._batch, self.step)
        for step in range(self.step, self.steps):
            given, wanted = coming.result()
            coming = ahead.submit(self._batch, step + 1)
            yield given, wanted

    def _batch(self, step: int) -> tuple[Tensor, Tensor]:
        share = self.training.batch // self.group.size
        first = step * self.training.batch + self.group.rank * share
        chosen = [self._order(at // len(self.train))[at % len(self.train)]
                  for at in range(first, first + share)]  # fmt: skip
        given, wanted = self.train.images(np.array(chosen))
        return torch.from_numpy(given), torch.from_numpy(wanted)

    @lru_cache(maxsize=2)  # noqa: B019  It lives as long as the training.
    def _order(self, epoch: int) -> NDArray[np.intp]:
        """The order of the frames in an epoch."""
        rng = np.random.default_rng([self.training.seed, epoch])
        return rng.permutation(len(self.train))

    def _learn(self, given: Tensor, wanted: Tensor) -> list[float]:
        """One step of the optimiser; the losses before it."""
        key = [self.training.seed, self.step, self.group.rank]
        torch.manual_seed(int(np.random.SeedSequence(key).generate_state(1)[0]))
        self.learner.net.train()
        device = self.group.device
        losses = self.learner.learn(
            given.to(device).float(),
            wanted.to(device).float(),
            self.training.rate * min(1.0, 2.0 - 2.0 * self.step / self.steps),
        )
        means: list[float] = self.group.mean(losses).tolist()
        return means

    def _note(self) -> None:
        """Validate, and write it down."""
        epoch = self.step * self.training.batch / len(self.train)
        entry = {"step": self.step, "epoch": round(epoch, 3)}
        entry |= dict(zip(self.learner.LOSSES, np.mean(self.losses, axis=0).tolist(), strict=True))
        self.log.append(entry | images_alike(self.learner.net, self.validation))
        lines = "".join(json.dumps(line) + "\n" for line in self.log)
        write_whole(self.out / "log.jsonl", lines.encode())


def told(entry: dict[str, float]) -> str:
    """An entry of the log in a few words."""
    shown = [f"{name.replace('_', ' ')} {value:.3f}" for name, value in entry.items()
             if name not in ("step", "epoch")]  # fmt: skip
    return f"epoch {entry['epoch']:g}: " + ", ".join(shown)


def train_images(
    config: ImageConfig,
    training: ImageTraining,
    data: Path,
    out: Path,
    threads: int,
    stopping: Event | None = None,
) -> Path:
    """Train a network, unless it is there; the path of its weights.

    Args:
        config: the network; `turned` is set to what the data are.
        training: how it learns.
        data: folder that `predictor.dataset` has made, or `predictor.drives`.
        out: folder of checkpoint, log and weights.
        threads: of this process.
        stopping: see `ImageTrainer.run`.

    Raises:
        TrainError: if it cannot be done or taken up.
        Stopped: if it was to stop before its end.
    """
    torch.set_num_threads(threads)
    of_drives = (data / RECIPE).exists()
    train, validation = (_samples if of_drives else _frames)(data)
    config = dataclasses.replace(config, turned=of_drives)
    weights = out / f"{config.arch}.safetensors"
    if is_trained(weights, described(config, training, (train.digest, validation.digest))):
        return weights
    group = Group.join()
    try:
        return ImageTrainer(config, training, train, validation, out, group).run(stopping)
    finally:
        group.leave()


def _frames(data: Path) -> list[Frames]:
    """The frames of a data set, to learn from and to validate on."""
    try:
        return [Frames.load(data, split) for split in ("train", "validation")]
    except FramesError as error:
        raise TrainError(f"--data: {error}") from None


def _samples(data: Path) -> list[SampleFrames]:
    """The samples of drives, likewise."""
    try:
        return [SampleFrames(Samples.load(data / split)) for split in ("train", "validation")]
    except SamplesError as error:
        raise TrainError(f"--data: {error}") from None
