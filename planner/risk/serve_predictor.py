"""The process of a predictor: it makes the predictor, and answers one question after another.

A question is the pose and the frames of the maps, pickled. A reply is a JSON list of a kind and a
value, since the planner unpickles nothing that this process sends. Cells and probabilities are
passed in shared memory.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import pickle
import select
import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.errors import one_line
from foresee.mapping.grid import Grid, GridFrame
from foresee.prediction import BadPredictionError, Caller, RaisedError, View

LONGEST = 1 << 16
"""Largest question or reply [bytes]."""


class SharedMemory:
    """Memory that the two processes share: a file without a name, which ends with them.

    Args:
        descriptor: file descriptor of the memory.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._buffer: mmap.mmap | bytes = b""

    def arrays(
        self, frames: Sequence[GridFrame]
    ) -> tuple[NDArray[np.float32], list[NDArray[np.int8]]]:
        """Return the arrays for a question and its answer; the memory grows if it is too small.

        Args:
            frames: frame of the predicted square, and of the larger square if there is one.

        Returns:
            p_free, p_occupied and confidence of the answer, (3, rows, columns), and the cells of
            the map on each frame.
        """
        sizes = [frame.shape[0] * frame.shape[1] for frame in frames]
        needed = 12 * sizes[0] + sum(sizes)
        if len(self._buffer) < needed:
            # Kept for later questions, since the first access to each page takes time.
            if os.fstat(self._descriptor).st_size < needed:
                os.ftruncate(self._descriptor, needed)
            self._buffer = mmap.mmap(self._descriptor, needed)
        ends = 12 * sizes[0] + np.cumsum(sizes)
        cells = [
            np.frombuffer(self._buffer, np.int8, size, end - size).reshape(frame.shape)
            for frame, size, end in zip(frames, sizes, ends.tolist(), strict=True)
        ]
        fields = np.frombuffer(self._buffer, np.float32, 3 * sizes[0])
        return fields.reshape(3, *frames[0].shape), cells


def serve(memory: int, connection: int, lifeline: int) -> None:
    """Make a predictor, and answer questions until the planner closes the connection.

    Args:
        memory: file descriptor of the shared memory. At first it holds the factory of the predictor
            and its arguments, pickled.
        connection: file descriptor of the socket for questions and replies.
        lifeline: file descriptor of a pipe whose other end the planner's process holds open.
    """
    _end_with(lifeline)
    with contextlib.suppress(OSError):
        # If memory runs out, the kernel ends this process, and not the planner's.
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    planner, here = socket.socket(fileno=connection), os.getpid()
    try:
        with os.fdopen(memory, "rb", closefd=False) as file:
            factory, arguments = pickle.load(file)
        caller = Caller(factory(*arguments))
        reply: tuple[str, Any] = "ready", (caller.context_side, caller.side)
    except BaseException as error:
        reply = "failed", one_line(error)
    planner.send(json.dumps(reply).encode())
    shared = SharedMemory(memory)
    while question := planner.recv(LONGEST):
        pose, frames = pickle.loads(question)
        fields, cells = shared.arrays(frames)
        grids = list(map(Grid, frames, cells))
        try:
            # The view that the predictor gets is a copy, which lies in its own memory.
            answer = caller.ask(View(grids[0], pose, grids[-1]))
            reply = "answer", (answer.nan_cells, answer.doubt)
        except RaisedError as error:
            answer, reply = None, ("raised", str(error))
        except BadPredictionError as error:
            answer, reply = None, ("bad", str(error))
        except BaseException as error:
            # As in a thread: what a plug-in raises does not end the process.
            answer, reply = None, ("raised", f"the predictor raised {type(error).__name__}")
        if os.getpid() != here:
            # The predictor has forked: one of the two answers.
            os._exit(0)
        if answer is not None:
            fields[:] = answer.p_free, answer.p_occupied, answer.confidence
        planner.send(json.dumps(reply).encode())


def _end_with(lifeline: int) -> None:
    """Let the kernel kill this process, and those that it starts, when a pipe is closed.

    The signal cannot be ignored, and no thread is needed, which a predictor could hold up.
    """
    fcntl.fcntl(lifeline, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([lifeline], [], [], 0.0)[0]:
        # It was closed before.
        sys.exit(1)
