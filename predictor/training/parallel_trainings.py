"""Several trainings in parallel, each in a process of its own; a failure stops no other one."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import one_line
from foresee.infra.plain_json import loads
from foresee.infra.workers import follow_parent, interrupts_blocked
from predictor.networks.image_config import ImageConfig
from predictor.training.checkpoint import is_trained
from predictor.training.image_training import train_images
from predictor.training.settings import ImageTraining, described
from predictor.training.trainer import Stopped, summary_of

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

LOOK_EVERY = 2.0
"""Time between two looks at the logs of the trainings [s]."""


@dataclass(frozen=True)
class Training:
    """One training of a study.

    Attributes:
        config: settings of the network.
        training: settings of the training.
        data: folder of the frames.
        digests: digests of the training frames and of the validation frames.
        out: folder of this training alone.
    """

    config: ImageConfig
    training: ImageTraining
    data: Path
    digests: tuple[str, str]
    out: Path

    @property
    def name(self) -> str:
        """Name of the training in the table, and of its folder."""
        return self.out.name

    def finished(self) -> bool:
        """Return whether weights of this network exist, trained in this way on these frames.

        Raises:
            TrainError: if the weights are damaged, or were trained in another way.
        """
        facts = described(self.config, self.training, self.digests)
        return is_trained(self.out / f"{self.config.arch}.safetensors", facts)

    def train(self, parent: int) -> None:
        """Train in this process; on failure write one line to failed.txt.

        Args:
            parent: process number of the study, with which this process ends.
        """
        follow_parent(parent)
        stopping = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: stopping.set())
        try:
            with (
                (self.out / "output.txt").open(
                    "a", encoding="utf-8", errors="backslashreplace"
                ) as file,
                contextlib.redirect_stderr(file),
            ):
                try:
                    # One thread each: the sums are the same, however many train at a time.
                    train_images(self.config, self.training, self.data, self.out, 1, stopping)
                except Stopped:
                    pass
                except Exception as error:
                    traceback.print_exc()
                    self._failure.write_text(
                        one_line(error).removeprefix("TrainError: "), encoding="utf-8"
                    )
        except OSError:
            # On a full disk the failure cannot be written; the study reports that the process died.
            raise SystemExit(1) from None

    def start(self) -> SpawnProcess:
        """Start or resume the training in a process of its own."""
        self.out.mkdir(parents=True, exist_ok=True)
        self._failure.unlink(missing_ok=True)
        # Spawned, since a fork would copy threads and locks of libraries in an undefined state.
        context = multiprocessing.get_context("spawn")
        process = context.Process(target=self.train, args=(os.getpid(),))
        with interrupts_blocked():
            process.start()
        return process

    def outcome(self, process: SpawnProcess) -> str:
        """Wait for the process to end; return "finished", or "failed: " and the reason."""
        process.join()
        if self._failure.exists():
            return f"failed: {self._failure.read_text(encoding='utf-8')}"
        return "finished" if self.finished() else f"failed: its process died ({process.exitcode})"

    def last(self) -> str:
        """Return the last entry of its log as one line; empty if there is none yet."""
        try:
            return summary_of(
                loads((self.out / "log.jsonl").read_text(encoding="utf-8").splitlines()[-1])
            )
        except (OSError, ValueError, IndexError):
            return ""

    @property
    def _failure(self) -> Path:
        return self.out / "failed.txt"


class Study:
    """Several trainings, a few at a time, each in a process of its own.

    Args:
        trainings: trainings, in the order in which they start.
        out: folder of status.txt.

    Raises:
        TrainError: if weights of another study are in the way.
    """

    def __init__(self, trainings: list[Training], out: Path) -> None:
        self.trainings, self.out = trainings, out
        out.mkdir(parents=True, exist_ok=True)
        self.state = {
            training: "finished" if training.finished() else "waiting" for training in trainings
        }

    def train(self, jobs: int, minutes: float = math.inf) -> None:
        """Train what is missing, with a progress bar and a line for each start and end.

        Args:
            jobs: number of trainings at a time.
            minutes: time after which running trainings are stopped; they can be resumed.
        """
        todo = [training for training in self.trainings if self.state[training] == "waiting"]
        running: dict[Any, tuple[Training, SpawnProcess]] = {}
        done, end = len(self.trainings) - len(todo), time.monotonic() + 60 * minutes
        with tqdm(total=len(self.trainings), initial=done, unit="network") as bar:

            def enter(training: Training, state: str) -> None:
                self.state[training] = state
                bar.write(self.line(training), file=sys.stderr)

            try:
                while (todo or running) and time.monotonic() < end:
                    while todo and len(running) < jobs:
                        training = todo.pop(0)
                        process = training.start()
                        running[process.sentinel] = training, process
                        enter(training, "running")
                    for sentinel in wait(list(running), timeout=LOOK_EVERY):
                        training, process = running.pop(sentinel)
                        enter(training, training.outcome(process))
                        bar.update()
                    lasts = (f"{now.name} {now.last()}" for now, _ in running.values())
                    bar.set_postfix_str(" | ".join(lasts))
                    self._note()
            finally:
                for training, process in running.values():
                    process.terminate()
                    process.join()
                    self.state[training] = "finished" if training.finished() else "stopped"
                self._note()

    def line(self, training: Training) -> str:
        """Return state, epoch and losses of a training as one line."""
        return f"{training.name:14} {self.state[training]}  {training.last()}".rstrip()

    def table(self) -> str:
        """Return the lines of all trainings."""
        return "\n".join(map(self.line, self.trainings))

    def failures(self) -> int:
        """Return how many trainings have failed."""
        return sum(state.startswith("failed") for state in self.state.values())

    def _note(self) -> None:
        write_whole(self.out / "status.txt", (self.table() + "\n").encode())
