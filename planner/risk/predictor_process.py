"""A predictor in a process of its own, which can neither delay nor end the planner's process."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from foresee.mapping.grid import Grid
from foresee.prediction import (
    BadPredictionError,
    Prediction,
    Predictor,
    RaisedError,
    View,
    checked,
)
from planner.risk.ask_predictor import FIRST_DEADLINE, LateError
from planner.risk.serve_predictor import LONGEST, SharedMemory

STARTING = 60.0
"""Longest time from the start of a new process to its first answer [s]."""
STUCK = 1.0
"""Time after which a process that still works on a question is killed [s]."""
PAUSE, LONGEST_PAUSE = 0.5, 60.0
"""Time from the first kill to the next start, which doubles with each further kill, up to the
longest [s]."""
CODE = """\
import sys
memory, connection, lifeline = map(int, sys.argv[1:4])
sys.path[:] = sys.argv[4:]
from planner.risk.serve_predictor import serve
serve(memory, connection, lifeline)
"""
"""Program of the process."""


class PredictorProcess:
    """Runs a predictor in a process of its own, and keeps every deadline whatever it does.

    A `Navigator` accepts it as its predictor. A process that dies, or still works on a question
    after `STUCK`, is killed with all processes that it has started, and started again after a
    pause. It also ends with this process, even if that is killed. Only on Linux.

        PredictorProcess(load_predictor, "compact")

    Args:
        factory: function or class that makes the predictor. It is called in the new process, so it
            must be importable there: it may not be defined in the main script.
        arguments: arguments of `factory`.

    Attributes:
        context_side: side of the larger square that the predictor wants to see [m]; 0: none.
        side: side of the square that it predicts [m]; 0: it states none.

    Raises:
        BadPredictionError: if the predictor cannot be made.
    """

    def __init__(self, factory: Callable[..., Predictor], *arguments: Any) -> None:
        self._recipe = pickle.dumps((factory, arguments))
        self._failures, self._retry = 0, 0.0
        self._asked: Grid | None = None
        """Map of a question whose answer was late."""
        self._server = _Server(self._recipe, FIRST_DEADLINE)
        try:
            _, sides = self._receive(self._server.limit)
        except LateError:
            late = f"the predictor was not ready after {FIRST_DEADLINE:g} s"
            raise BadPredictionError(late) from None
        self.context_side, self.side = map(float, sides)

    def predict(self, view: View) -> Prediction:
        """Return the prediction; see `Predictor`."""
        return self.ask(view, FIRST_DEADLINE)

    def ask(self, view: View, patience: float) -> Prediction:
        """Ask for a prediction, and check it.

        Args:
            view: what was observed.
            patience: time to wait for the prediction [s].

        Raises:
            LateError: if there is no prediction after `patience`, an earlier question is still
                being answered, or the process is being started again.
            RaisedError: if the predictor raised any exception, or its process ended.
            BadPredictionError: if the answer breaks the contract of predictors.
        """
        deadline = time.monotonic() + patience
        if self._server.is_killed:
            self._restart()
        if self._server.is_busy:
            # It has just been started, or an answer was late, which nobody has taken.
            self._receive(0.0)
        self._asked = view.known
        self._server.ask(view, patience)
        return self._answer(view.known, *self._receive(deadline))

    def take_late(self) -> Prediction | None:
        """Return the answer to an earlier question that was late, once; None if there is none.

        If it was an error, nothing is returned.
        """
        known, self._asked = self._asked, None
        if known is None or self._server.is_killed or not self._server.is_busy:
            return None
        try:
            return self._answer(known, *self._receive(0.0))
        except LateError:
            self._asked = known
        except BadPredictionError:
            # The tick in which it was late has counted it.
            pass
        return None

    def _answer(self, known: Grid, kind: str, value: Any) -> Prediction:
        """Return the prediction in a reply to a question about a map, and check it."""
        if kind == "raised":
            raise RaisedError(str(value))
        if kind != "answer":
            raise BadPredictionError(str(value))
        # Checked again, since the other process may have written anything into the memory.
        try:
            nan_cells, doubt = value
        except (TypeError, ValueError):
            raise BadPredictionError(f"the predictor's process answered {value!r}") from None
        p_free, p_occupied, confidence = self._server.fields
        answer = checked(
            Prediction(known.frame, p_free, p_occupied, confidence, doubt=doubt), known
        )
        self._failures, self._server.first_limit = 0, 0.0
        return replace(answer, nan_cells=nan_cells)

    def close(self) -> None:
        """End the process; later questions count as late."""
        self._server.close()
        self._retry = float("inf")

    def _restart(self) -> None:
        """Start a new process, after a pause and when the old one has ended."""
        if time.monotonic() < self._retry or not self._server.has_ended():
            raise LateError
        self._server.close()
        try:
            self._server = _Server(self._recipe, STARTING)
        except OSError:
            self._fail()
            raise LateError from None

    def _receive(self, until: float) -> tuple[str, Any]:
        """Return the kind and the value of the next reply, if it arrives in time."""
        reply = self._server.receive(until)
        if reply is None:
            if time.monotonic() >= self._server.limit:
                self._fail()
            raise LateError
        try:
            kind, value = json.loads(reply)
        except (ValueError, TypeError):
            kind, value = "failed", "the predictor's process ended"
        if kind == "failed":
            self._fail()
            raise RaisedError(str(value))
        return kind, value

    def _fail(self) -> None:
        """Kill the process, and set the time of the next start."""
        self._server.kill()
        pause = PAUSE * 2.0 ** min(self._failures, 16)
        self._failures += 1
        self._retry = time.monotonic() + min(pause, LONGEST_PAUSE)


class _Server:
    """The process of a predictor, seen from the planner's process.

    Args:
        recipe: factory of the predictor and its arguments, pickled.
        patience: time to its first answer after which it counts as stuck [s].

    Attributes:
        fields: p_free, p_occupied and confidence of the last answer, (3, rows, columns).
        first_limit: time before which it does not count as stuck; 0 once it has answered.
        limit: time at which it counts as stuck if it has not replied.
        is_busy: whether it owes a reply.
        is_killed: whether it was killed.

    Raises:
        OSError: if it cannot be started.
    """

    def __init__(self, recipe: bytes, patience: float) -> None:
        self.limit = self.first_limit = time.monotonic() + patience
        self.is_busy, self.is_killed = True, False
        with contextlib.ExitStack() as opened, contextlib.ExitStack() as given:
            memory = os.memfd_create("predictor")
            opened.callback(os.close, memory)
            os.pwrite(memory, recipe, 0)
            self._memory = SharedMemory(memory)
            self._socket, child_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            opened.callback(self._socket.close)
            given.callback(child_end.close)
            lifeline, our_end = os.pipe()
            opened.callback(os.close, our_end)
            given.callback(os.close, lifeline)
            descriptors = memory, child_end.fileno(), lifeline
            self._process = subprocess.Popen(
                [sys.executable, "-c", CODE, *map(str, descriptors), *sys.path],
                stdin=subprocess.DEVNULL,
                pass_fds=descriptors,
                start_new_session=True,
            )
            opened.callback(_end, self._process, os.getpid())
            self._finalizer = weakref.finalize(self, opened.pop_all().close)

    def ask(self, view: View, patience: float) -> None:
        """Send a question, which may take some time [s]."""
        grids = [view.known] if view.around is view.known else [view.known, view.around]
        frames = [grid.frame for grid in grids]
        self.fields, cells = self._memory.arrays(frames)
        for shared, grid in zip(cells, grids, strict=True):
            shared[:] = grid.cells
        self.limit = max(time.monotonic() + max(patience, STUCK), self.first_limit)
        self.is_busy = True
        # If the process has ended, this is noticed when the reply is read.
        with contextlib.suppress(OSError):
            self._socket.send(pickle.dumps((view.pose, frames)))

    def receive(self, until: float) -> bytes | None:
        """Return the next reply; empty if the process has ended, None if it is not there in time.

        Args:
            until: time to wait until, of `time.monotonic` [s].
        """
        self._socket.settimeout(max(0.0, until - time.monotonic()))
        try:
            reply = self._socket.recv(LONGEST)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError:
            reply = b""
        self.is_busy = False
        return reply

    def kill(self) -> None:
        """Kill the process and those that it has started; do not wait for their end."""
        self.is_killed = True
        _kill(self._process)

    def has_ended(self) -> bool:
        """Return whether the process has ended."""
        return self._process.poll() is not None

    def close(self) -> None:
        """End the process, and release what it shares with this one."""
        self.is_killed = True
        self._finalizer()


def _kill(process: subprocess.Popen[bytes]) -> None:
    if process.returncode is None:
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """Kill a process, and wait a moment for its end; a forked copy of its owner does nothing."""
    if os.getpid() == owner:
        _kill(process)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1.0)
