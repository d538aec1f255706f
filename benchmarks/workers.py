"""Drives spread over processes; the same results as one after the other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from numpy.typing import NDArray

from benchmarks.settings import Settings

Finished = tuple[int, str, dict[str, Any] | None, dict[str, NDArray], str]
"""Episode, arm, result (None: it could not be driven), arrays, why it could not."""

TRIES = 3
"""How often a pool that lost a process is started anew without a drive getting finished."""


def finished(settings: Settings, todo: list[tuple[int, str]], jobs: int) -> Iterator[Finished]:
    """Drive a list of episodes and arms, and yield each as it ends.

    Raises:
        BrokenProcessPool: if processes keep dying.
    """
    if jobs == 1:
        for index, arm in todo:
            yield _drive(settings, index, arm)
        return
    left = list(todo)
    failures = 0
    while left:
        pool = ProcessPoolExecutor(
            min(jobs, len(left)), multiprocessing.get_context("spawn"), initializer=_prepare
        )
        try:
            pending = {pool.submit(_drive, settings, index, arm) for index, arm in left}
            # Futures are let go of as they end: each holds its drive's whole trace.
            while pending:
                ended, pending = wait(pending, return_when=FIRST_COMPLETED)
                while ended:
                    result = ended.pop().result()
                    left.remove((result[0], result[1]))
                    failures = 0
                    yield result
        except BrokenProcessPool:
            # A native library crashed one process, and the pool with it. Go on with a new one.
            failures += 1
            if failures == TRIES:
                raise
        finally:
            for process in list((pool._processes or {}).values()):
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)


def _prepare() -> None:
    """Leave Ctrl-C to the parent, and end when the parent does, even if it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# Before a worker imports numpy: threads of its libraries would fight over the cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


def _drive(settings: Settings, index: int, arm: str) -> Finished:
    from benchmarks.drive import drive
    from sim.task import NoTaskError

    try:
        result, arrays = drive(settings, index, arm)
    except NoTaskError as error:
        return index, arm, None, {}, str(error)
    return index, arm, result, arrays, ""
