"""Train all of the paper's networks: three and a perceptron, at five expansions each.

    python -m predictor.study --preset short        all 20, in two or three hours of 2 cores
    python -m predictor.study                       as printed: months, without a GPU
    python -m predictor.study --epochs 2 --batch 32 --bf16 --minutes 20        on a GPU for a while

In order of worth, so that whenever it is stopped, what matters most is there. What is finished is
passed over, what was begun goes on, and what fails is shown and stops no other.
"""

from __future__ import annotations

import argparse
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

from predictor.infra.atomic_file import write_whole
from predictor.infra.command_line import OneLineParser, between, run_command
from predictor.infra.errors import one_line
from predictor.infra.plain_json import loads
from predictor.networks import ARCHITECTURES
from predictor.networks.image_config import EXPANSIONS, ImageConfig, ImageTraining, described
from predictor.training.checkpoint import TrainError, is_trained
from predictor.training.image_arguments import add_arguments, configured

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

FIRST = (1.1, 1.3, 2.0)
"""Expansions that are worth most."""
ORDER = tuple(
    (arch, expansion)
    for archs, expansions in (
        (("unet_ff", "resnet_ff", "gan"), FIRST),
        (("unet_ff", "resnet_ff", "gan"), tuple(x for x in EXPANSIONS if x not in FIRST)),
        (("mlp",), EXPANSIONS),
    )
    for arch in archs
    for expansion in expansions
)
"""All trainings, what is worth most first."""
LOOK_EVERY = 2.0
"""Between two looks at what the trainings have logged [s]."""


@dataclass(frozen=True)
class Data:
    """What a study learns from.

    Attributes:
        folder: of the frames.
        digests: of those to learn from, and of those to validate on.
    """

    folder: Path
    digests: tuple[str, str]

    @classmethod
    def of(cls, folder: Path) -> Data:
        """What a folder holds.

        Raises:
            TrainError: if it does not hold frames to train and to validate on.
        """
        from predictor.data.frames import Frames, FramesError

        try:
            train, validation = (Frames.load(folder, name) for name in ("train", "validation"))
        except FramesError as error:
            raise TrainError(f"--data: {error}") from None
        return cls(folder, (train.digest, validation.digest))


@dataclass(frozen=True)
class Run:
    """One training of a study.

    Attributes:
        config: the network.
        training: how it learns.
        data: from what.
        out: its own folder.
    """

    config: ImageConfig
    training: ImageTraining
    data: Data
    out: Path

    @property
    def name(self) -> str:
        """Of its folder, and in the table."""
        return self.out.name

    def finished(self) -> bool:
        """Whether weights of this network are there, trained in this way on these frames.

        Raises:
            TrainError: if what is there is damaged, or was trained in another way.
        """
        return is_trained(
            self.out / f"{self.config.arch}.safetensors",
            described(self.config, self.training, self.data.digests),
        )

    def train(self, parent: int) -> None:
        """Train, in a process of its own, which leaves a line if it fails.

        Args:
            parent: process number of the one that begins it.
        """
        from predictor.infra.workers import follow_parent
        from predictor.training.image_training import train_images
        from predictor.training.trainer import Stopped

        follow_parent(parent)
        stopping = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: stopping.set())
        with (self.out / "output.txt").open("a") as file, contextlib.redirect_stderr(file):
            try:
                # One thread each: the sums are the same, however many train at a time.
                train_images(self.config, self.training, self.data.folder, self.out, 1, stopping)
            except Stopped:
                return
            except Exception as error:
                traceback.print_exc()
                line = one_line(error)
                self._failure.write_text(line.removeprefix("TrainError: "))

    def start(self) -> SpawnProcess:
        """Begin to train, or go on."""
        self.out.mkdir(parents=True, exist_ok=True)
        self._failure.unlink(missing_ok=True)
        # Not forked: that would copy threads and locks of libraries as they happen to be.
        context = multiprocessing.get_context("spawn")
        process = context.Process(target=self.train, args=(os.getpid(),))
        process.start()
        return process

    def outcome(self, process: SpawnProcess) -> str:
        """How a process that has ended did."""
        process.join()
        if self._failure.exists():
            return f"failed: {self._failure.read_text()}"
        return "finished" if self.finished() else f"failed: its process died ({process.exitcode})"

    def last(self) -> str:
        """Where it is, and the last of its losses; empty if there is nothing yet."""
        from predictor.training.trainer import summary_of

        try:
            return summary_of(loads((self.out / "log.jsonl").read_text().splitlines()[-1]))
        except (OSError, ValueError, IndexError):
            return ""

    @property
    def _failure(self) -> Path:
        return self.out / "failed.txt"


class Study:
    """Trainings, some at a time, each in a process of its own.

    Args:
        runs: in order of worth.
        out: folder of the table.

    Raises:
        TrainError: if what is there already belongs to another study.
    """

    def __init__(self, runs: list[Run], out: Path) -> None:
        self.runs, self.out = runs, out
        out.mkdir(parents=True, exist_ok=True)
        self.state = {run: "finished" if run.finished() else "waiting" for run in runs}

    def train(self, jobs: int, minutes: float = math.inf) -> None:
        """Train what is missing, with a bar over all and a line for each that begins or ends.

        Args:
            jobs: how many at a time.
            minutes: after which those that train are stopped; they may go on another time.
        """
        from tqdm import tqdm

        todo = [run for run in self.runs if self.state[run] == "waiting"]
        running: dict[Any, tuple[Run, SpawnProcess]] = {}
        done, end = len(self.runs) - len(todo), time.monotonic() + 60 * minutes
        with tqdm(total=len(self.runs), initial=done, unit="network") as bar:
            try:
                while (todo or running) and time.monotonic() < end:
                    while todo and len(running) < jobs:
                        run = todo.pop(0)
                        process = run.start()
                        running[process.sentinel] = run, process
                        self.state[run] = "running"
                        bar.write(self.line(run), file=sys.stderr)
                    for sentinel in wait(list(running), timeout=LOOK_EVERY):
                        run, process = running.pop(sentinel)
                        self.state[run] = run.outcome(process)
                        bar.write(self.line(run), file=sys.stderr)
                        bar.update()
                    bar.set_postfix_str(" | ".join(f"{run.name} {run.last()}"
                                                   for run, _ in running.values()))  # fmt: skip
                    self._note()
            finally:
                for run, process in running.values():
                    process.terminate()
                    process.join()
                    self.state[run] = "finished" if run.finished() else "stopped"
                self._note()

    def line(self, run: Run) -> str:
        """State, epoch and losses of one."""
        return f"{run.name:14} {self.state[run]}  {run.last()}".rstrip()

    def table(self) -> str:
        """A line each."""
        return "\n".join(self.line(run) for run in self.runs)

    def failures(self) -> int:
        """How many have failed."""
        return sum(state.startswith("failed") for state in self.state.values())

    def _note(self) -> None:
        write_whole(self.out / "status.txt", (self.table() + "\n").encode())


def main(argv: list[str] | None = None) -> int:
    """Run the command line; 1 if a training failed, 2 for bad arguments, 130 if interrupted."""
    parser = OneLineParser(
        prog="predictor.study",
        description="Train the paper's networks at its five expansions, what is worth most first. "
        "Interrupted, it goes on where it was: give the same command again. OUT/status.txt always "
        "holds a line each.",
    )
    add = parser.add_argument
    add("--data", type=Path, default=Path("data/simulated"), metavar="DIR",
        help="frames of predictor.dataset (default: %(default)s)")  # fmt: skip
    add("--out", type=Path, metavar="DIR", help="a folder each: checkpoint, log, curve and weights "
        "(default: results/study-PRESET)")  # fmt: skip
    add("--archs", nargs="+", choices=ARCHITECTURES, default=ARCHITECTURES, metavar="A",
        help=f"of {', '.join(ARCHITECTURES)} (default: all)")  # fmt: skip
    add("--expansions", nargs="+", type=float, choices=EXPANSIONS, default=EXPANSIONS, metavar="X",
        help=f"of {', '.join(map(str, EXPANSIONS))} (default: all)")  # fmt: skip
    add(
        "--jobs",
        type=between(1, 10_000),
        metavar="N",
        help="trainings at a time, of one thread each (default: one a core; with a GPU 1)",
    )
    add(
        "--minutes",
        type=between(1e-3, math.inf),
        default=math.inf,
        metavar="M",
        help="stop after so long; what was "
        "begun goes on when the command is given again (default: at the end)",
    )
    add_arguments(parser)
    add("--batch", type=int, metavar="N", help="frames a step (default: the preset's)")
    add("--rate", type=float, metavar="R", help="learning rate (default: the preset's)")
    add("--seed", type=int, metavar="N", help="of first weights and order of frames "
        "(default: 0)")  # fmt: skip
    return run_command("predictor.study", lambda: _run(parser.parse_args(argv)))


def _run(args: argparse.Namespace) -> int:
    out = args.out or Path("results") / f"study-{args.preset or 'paper'}"
    data = Data.of(args.data)
    runs = [
        Run(*configured(args, arch, expansion), data, out / f"{arch}-{expansion:.1f}")
        for arch, expansion in ORDER
        if arch in args.archs and expansion in args.expansions
    ]
    study = Study(runs, out)
    study.train(args.jobs or _at_a_time(), args.minutes)
    print(study.table())
    return 1 if study.failures() else 0


def _at_a_time() -> int:
    import torch

    return 1 if torch.cuda.is_available() else os.cpu_count() or 1


if __name__ == "__main__":
    sys.exit(main())
