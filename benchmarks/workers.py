"""Work spread over processes; the same results as one after the other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

TRIES = 3
"""How often a pool that lost a process is started anew without an item getting finished."""


def finished(
    work: Callable[[Item], Result], todo: list[Item], jobs: int
) -> Iterator[tuple[Item, Result]]:
    """Do a list of things, and yield each with its result as it ends.

    Args:
        work: does one; it must be picklable, and bring heavy imports with it only when called.
        todo: the things.
        jobs: processes; 1: this one.

    Raises:
        BrokenProcessPool: if processes keep dying.
    """
    if jobs == 1:
        for item in todo:
            yield item, work(item)
        return
    left = list(todo)
    failures = 0
    while left:
        pool = ProcessPoolExecutor(
            min(jobs, len(left)), multiprocessing.get_context("spawn"), initializer=_prepare
        )
        try:
            pending = {pool.submit(work, item): item for item in left}
            # Futures are let go of as they end: each holds its drive's whole trace.
            while pending:
                ended, _ = wait(pending, return_when=FIRST_COMPLETED)
                while ended:
                    future = ended.pop()
                    item = pending.pop(future)
                    result = future.result()
                    left.remove(item)
                    failures = 0
                    yield item, result
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
