"""Predictors that misbehave as only a process of their own can bear, and what they are asked."""

import contextlib
import ctypes
import os
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction, View

FOREVER = 1000
"""Longer than any test waits [s]."""


def random_view(side=60, seed=0):
    """A view of random cells: a square of `side` cells inside one of twice as many."""
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), size=(2 * side, 2 * side))
    around = Grid(GridFrame(0.05, (-1.0, 0.3), cells.shape), cells)
    frame = around.frame.square(0.5, 1.5, side * 0.05)
    return View(around.crop(frame), np.array([0.5, 1.5, 0.7]), around)


def good(view):
    values = np.full(view.known.frame.shape, 0.5, np.float32)
    return Prediction(view.known.frame, values, values, values, doubt=3.0)


def holds_the_lock():
    # A call by PyDLL does not release the lock of the interpreter.
    ctypes.PyDLL(None).sleep(FOREVER)


def spins():
    while True:
        pass


def crashes():
    ctypes.string_at(0)


def exits():
    os._exit(0)


def kills_itself():
    os.kill(os.getpid(), signal.SIGKILL)


def exhausts_its_memory():
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used, used))
    kept = []
    while True:
        kept.append(bytearray(1 << 20))


def prints_and_hangs():
    sys.stdout.write("nothing that a planner reads\n" * 10_000)
    sys.stdout.flush()
    os.write(1, b"neither is this\n")
    time.sleep(FOREVER)


def ignores_signals():
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
        with contextlib.suppress(OSError, ValueError):
            signal.signal(number, signal.SIG_IGN)
    time.sleep(FOREVER)


def closes_everything():
    os.closerange(0, 1000)


def forks_and_hangs():
    if os.fork() == 0:
        time.sleep(FOREVER)
        os._exit(0)
    time.sleep(FOREVER)


def raises():
    raise RuntimeError("as in a thread")


@dataclass(frozen=True)
class Raises:
    """Raise an exception of a kind."""

    kind: type[BaseException]

    def __call__(self):
        raise self.kind


class Misbehaving:
    """Answer well twice, and misbehave from then on; with a file, only if it is not there yet."""

    context_side = 0.0

    def __init__(self, misbehave, once=None):
        self.misbehave, self.once, self.calls = misbehave, once, 0

    def predict(self, view):
        self.calls += 1
        if self.calls > 2 and not (self.once and self.once.exists()):
            if self.once:
                self.once.write_text(str(os.getpid()))
            self.misbehave()
        return good(view)


class Forks:
    """Answer in two processes at once."""

    def predict(self, view):
        os.fork()
        return good(view)


def fails():
    raise RuntimeError("there is no such network")


class Wrong:
    def predict(self, view):
        return "free everywhere"
