"""The training loop: steps, validation, log, checkpoints and export, for every kind of network.

A checkpoint contains the whole state of a training, and the batch of a step depends on its number
and the seed alone. A training that was killed and is continued by the same command therefore ends
with the same weights as one that was not killed, on a CPU to the last bit.
"""

from __future__ import annotations

import io
import json
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from foresee.infra.atomic_file import clear, write_whole
from foresee.infra.drawing import new_figure, own_style
from foresee.infra.environment import commit
from foresee.infra.errors import one_line
from foresee.infra.progress import progress
from predictor.training.checkpoint import TrainError, read_checkpoint, write_checkpoint
from predictor.training.optimisation import restore, states

SAVE_EVERY = 60.0
"""Time between two checkpoints [s]."""
SHOWN = (
    "loss",
    "l1",
    "adversarial",
    "discriminator",
    "validation_l1",
    "ssim",
    "nll",
    "iou_free",
    "ece_free",
)
"""Values of a log entry that the progress bar shows."""


class Stopped(Exception):
    """The time of a training was over before its last step; it can be resumed."""


class Trainer(ABC):
    """A training that can be interrupted and resumed.

    A subclass prepares its network and data, and then calls this constructor, which resumes from
    the checkpoint if there is one.

    Args:
        weights: file of the weights; its folder also contains the checkpoint, the log and the
            curve.
        facts: plain data that identify this training.
        steps: number of optimiser steps.
        note_every: number of steps from one validation to the next; the last step is always
            followed by one.
        device: device that computes.

    Attributes:
        step: number of steps made so far.
        log: one entry for each validation: "step", mean training losses since the validation
            before, validation measures.
        losses: training losses of each step since the last validation, (len(LOSSES),) each.
        seconds: time that the steps have taken, over all runs of the command [s].
        commits: commits of the code that the steps were made with.

    Raises:
        TrainError: if the folder holds another training.
    """

    LOSSES: tuple[str, ...] = ("loss",)
    """Names of the training losses that `_learn` returns."""
    CURVES: tuple[tuple[str, ...], ...]
    """Names of the values drawn in each panel of curve.png."""

    parts: dict[str, Any]
    """Networks and optimisers by name, whose state is in the checkpoint; set by the subclass."""

    def __init__(
        self,
        weights: Path,
        facts: dict[str, Any],
        steps: int,
        note_every: int,
        device: torch.device,
    ) -> None:
        self.weights, self.steps, self.note_every, self.device = weights, steps, note_every, device
        self.step, self.seconds = 0, 0.0
        self.log: list[dict[str, float]] = []
        self.losses: list[list[float]] = []
        self.commits: set[str] = set()
        self._facts = facts
        weights.parent.mkdir(parents=True, exist_ok=True)
        clear(weights.parent)
        state = read_checkpoint(self.checkpoint, facts, device)
        if state is not None:
            try:
                self._load(state["learner"])
                self.step, self.seconds = int(state["step"]), float(state["seconds"])
                self.log, self.losses = list(state["log"]), list(state["losses"])
                self.commits = set(state["commits"])
            except (LookupError, TypeError, ValueError, RuntimeError, AttributeError) as error:
                raise TrainError(
                    f"{self.checkpoint} is damaged: {one_line(error)}; delete it to start again"
                ) from error

    @property
    def checkpoint(self) -> Path:
        """Path of the checkpoint."""
        return self.weights.with_name("checkpoint.pt")

    def run(self, end: float = math.inf) -> Path:
        """Train to the end with a progress bar, export, and return the path of the weights.

        Args:
            end: time on the clock `time.monotonic` after which one more step is made [s].

        Raises:
            Stopped: if the time was over before the last step; there is a checkpoint.
        """
        code = commit() or "no checkout"
        saved = begun = time.monotonic()
        before = self.seconds
        with (
            progress(total=self.steps, initial=self.step, unit="step", smoothing=0.05) as bar,
            ThreadPoolExecutor(1) as ahead,
        ):
            for batch in self._batches(ahead):
                self.losses.append(self._learn(*batch))
                self.step += 1
                self.commits.add(code)
                bar.update()
                last = self.step == self.steps
                noted = self.step % self.note_every == 0 or last
                if noted:
                    self._note()
                    bar.set_postfix_str(summary_line(self.log[-1]), refresh=False)
                    self.losses = []
                stop = time.monotonic() > end and not last
                if time.monotonic() - saved > SAVE_EVERY or last or stop:
                    self.seconds = before + time.monotonic() - begun
                    self.save()
                    saved = time.monotonic()
                if stop:
                    raise Stopped
        self._export(self._facts | {"commit": " ".join(sorted(self.commits))})
        draw_curve(self.log, self.weights.with_name("curve.png"), self.CURVES)
        return self.weights

    def save(self) -> None:
        """Write the checkpoint."""
        names = ("step", "log", "losses", "seconds")
        state = {name: getattr(self, name) for name in names}
        state |= {"facts": self._facts, "commits": sorted(self.commits), "learner": self._state()}
        write_checkpoint(self.checkpoint, state)

    def _state(self) -> dict[str, Any]:
        """Return the state of networks and optimisers, plain data and tensors, for a checkpoint."""
        return states(self.parts)

    def _load(self, state: dict[str, Any]) -> None:
        """Restore the state that `_state` returned."""
        restore(self.parts, state)

    @abstractmethod
    def _batch(self, step: int) -> tuple[Tensor, ...]:
        """Return the batch of a step; called in another thread, ahead of time."""

    @abstractmethod
    def _learn(self, *batch: Tensor) -> list[float]:
        """Make one optimiser step, and return the training losses before it."""

    @abstractmethod
    def _measures(self) -> dict[str, float]:
        """Measure the network on the validation data."""

    @abstractmethod
    def _export(self, facts: dict[str, Any]) -> None:
        """Write the weights, with the facts of their training."""

    def _batches(self, ahead: ThreadPoolExecutor) -> Iterator[tuple[Tensor, ...]]:
        """Yield the batch of each further step; it is made in `ahead` during the step before."""
        if self.step == self.steps:
            return
        coming = ahead.submit(self._batch, self.step)
        for step in range(self.step + 1, self.steps):
            batch = coming.result()
            coming = ahead.submit(self._batch, step)
            yield batch
        yield coming.result()

    def _note(self) -> None:
        """Validate the network, append an entry to the log, and write the log."""
        means = np.mean(self.losses, axis=0).tolist()
        entry = {"step": self.step, **dict(zip(self.LOSSES, means, strict=True))}
        self.log.append(entry | self._measures())
        lines = "".join(json.dumps(line) + "\n" for line in self.log)
        write_whole(self.weights.with_name("log.jsonl"), lines.encode())


def common_facts(config: Any, net: Any, device: torch.device, *splits: Any) -> dict[str, Any]:
    """Return the facts that the trainings on samples have in common.

    Args:
        config: settings of the training, a dataclass.
        net: network with its configuration.
        device: device that computes.
        splits: samples to train on, and to validate on.
    """
    train, validation = splits
    return {
        "config": asdict(config),
        "network": json.loads(json.dumps(asdict(net.config))),
        # Device and threads decide the rounding of sums.
        "device": device.type,
        "threads (--jobs)": torch.get_num_threads(),
        "data": [train.digest, validation.digest],
        "samples": len(train),
        "worlds": sorted(train.worlds),
        "validation_worlds": sorted(validation.worlds),
    }


def spread(total: int, count: int) -> NDArray[np.intp]:
    """Return at most `count` of the numbers below `total`, evenly spread, to validate on."""
    return np.unique(np.linspace(0, total - 1, count).astype(np.intp))


def summary_line(entry: dict[str, float]) -> str:
    """Return the main values of a log entry as one line."""
    shown = ", ".join(
        f"{name.replace('_', ' ')} {value:.3f}" for name, value in entry.items() if name in SHOWN
    )
    return f"epoch {entry['epoch']:g}: {shown}" if "epoch" in entry else shown


@own_style()
def draw_curve(
    log: list[dict[str, float]], path: Path, panels: tuple[tuple[str, ...], ...]
) -> None:
    """Draw losses and validation measures over the steps.

    Args:
        log: entries, each with its "step".
        path: path of the picture.
        panels: names of the values drawn in each panel.
    """
    figure = new_figure(4 * len(panels), 3.4)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    steps = [entry["step"] for entry in log]
    for axis, names in zip(axes, panels, strict=True):
        for name in names:
            label = name.replace("_", " ") + (" (training)" if name == "loss" else "")
            axis.plot(steps, [entry[name] for entry in log], label=label)
        axis.set_xlabel("step")
        axis.grid(alpha=0.3)
        axis.legend(frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=130)
    write_whole(path, buffer.getvalue())
