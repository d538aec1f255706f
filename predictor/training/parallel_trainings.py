"""Several trainings in parallel; a failure of one stops no other."""

from __future__ import annotations

import contextlib
import math
import sys
import time
import traceback
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from foresee.infra.atomic_file import write_whole
from foresee.infra.errors import one_line
from foresee.infra.plain_json import loads
from foresee.infra.progress import progress
from foresee.infra.workers import LostError, finished
from predictor.networks.image_config import ImageConfig
from predictor.training.checkpoint import is_trained
from predictor.training.image_training import train_images
from predictor.training.settings import ImageTraining, described
from predictor.training.trainer import Stopped, summary_line


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

    def train(self, end: float) -> str:
        """Train to the end, or until the time is over; the output goes to output.txt.

        Args:
            end: see `Trainer.run`.

        Returns:
            The state: "finished", "stopped", "waiting" if the time was over before, or "failed: "
            and the reason.
        """
        if time.monotonic() > end:
            return "waiting"
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            output = self.out / "output.txt"
            with (
                output.open("a", encoding="utf-8", errors="backslashreplace") as file,
                contextlib.redirect_stderr(file),
            ):
                try:
                    # One thread each: the sums are the same, however many train at a time.
                    train_images(self.config, self.training, self.data, self.out, 1, end)
                    return "finished"
                except Stopped:
                    return "stopped"
                except Exception as error:
                    traceback.print_exc()
                    return f"failed: {one_line(error).removeprefix('TrainError: ')}"
        except OSError as error:
            # On a full disk, the output cannot be written.
            return f"failed: {one_line(error)}"

    def last(self) -> str:
        """Return the last entry of its log as one line; empty if there is none yet."""
        try:
            return summary_line(
                loads((self.out / "log.jsonl").read_text(encoding="utf-8").splitlines()[-1])
            )
        except (OSError, ValueError, IndexError):
            return ""


class Study:
    """Several trainings, a few at a time.

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
        """Train what is missing, with a progress bar and a line for each end.

        Args:
            jobs: number of trainings at a time.
            minutes: time after which running trainings are stopped; they can be resumed.
        """
        todo = [training for training in self.trainings if self.state[training] == "waiting"]
        done, end = len(self.trainings) - len(todo), time.monotonic() + 60 * minutes
        with progress(total=len(self.trainings), initial=done, unit="network") as bar:
            try:
                for training, state in finished(partial(_trained, end), todo, jobs):
                    self.state[training] = state
                    bar.write(self.line(training), file=sys.stderr)
                    bar.update()
                    self._note()
            except LostError as error:
                self.state |= dict.fromkeys(error.items, "failed: its process died")
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


def _trained(end: float, training: Training) -> str:
    return training.train(end)
