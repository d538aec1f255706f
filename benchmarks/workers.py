"""Work spread over processes by joblib, or over the machines of a Dask cluster.

The results are those of one thing after the other, whoever did them.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

# Before a worker imports numpy: threads of its libraries would fight over the cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

Item = TypeVar("Item")
Result = TypeVar("Result")

TRIES = 3
"""How often processes may die without an item getting finished, before that is given up."""


class WorkersError(RuntimeError):
    """Nobody is there to do the work, or they keep dying; the message is one line."""


def finished(
    work: Callable[[Item], Result], todo: list[Item], jobs: int, dask: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Do a list of things, and yield each with its result as it ends.

    Args:
        work: does one; it must be picklable, and bring heavy imports with it only when called.
        todo: the things.
        jobs: processes; 1: this one.
        dask: address of a Dask scheduler, whose workers do it in place of processes here.

    Raises:
        WorkersError: if there are no workers, or they keep dying.
    """
    if dask is not None:
        yield from _on_cluster(work, todo, dask)
    elif jobs == 1:
        for item in todo:
            yield item, work(item)
    else:
        yield from _in_processes(work, todo, jobs)


def _in_processes(
    work: Callable[[Item], Result], todo: list[Item], jobs: int
) -> Iterator[tuple[Item, Result]]:
    from concurrent.futures.process import BrokenProcessPool

    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor

    left = list(todo)
    failures = 0
    while left:
        # Two at least: joblib would do a single thing in this process, and die of it.
        pool = Parallel(max(2, min(jobs, len(left))), "loky", return_as="generator_unordered",
                        batch_size=1, initializer=follow_parent)  # fmt: skip
        try:
            for item, result in pool([delayed(_with_item)(work, item) for item in left]):
                left.remove(item)
                failures = 0
                yield item, result
        except BrokenProcessPool as error:
            # A native library crashed one process, and the pool with it. Go on with a new one.
            failures += 1
            if failures == TRIES:
                raise WorkersError("worker processes died again and again; try --jobs 1") from error
        finally:
            # Else they stay for minutes, and keep their memory.
            get_reusable_executor().shutdown(wait=False, kill_workers=True)


def _on_cluster(
    work: Callable[[Item], Result], todo: list[Item], address: str
) -> Iterator[tuple[Item, Result]]:
    # Dask's own interface, not joblib's: that waits for ever for a thing that killed its workers.
    from concurrent.futures import CancelledError

    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise WorkersError("--dask needs Dask: pip install 'foresee[dask]'") from None

    try:
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        raise WorkersError(f"no Dask scheduler answers at {address}: {error}") from None
    with client:
        if not client.nthreads():
            raise WorkersError(f"the Dask scheduler at {address} has no workers")
        waiting = list(reversed(todo))
        items: dict[Any, Item] = {}
        running = as_completed(loop=client.loop)
        while waiting or items:
            # No more than keeps all busy: a study may be a million drives long.
            threads = client.nthreads()
            if not set(threads.values()) <= {1}:
                # OMPL has one random generator a process: two drives in one would disturb it.
                raise WorkersError("a drive needs a process of its own: dask worker --nthreads 1")
            while waiting and len(items) < 3 * max(1, len(threads)):
                item = waiting.pop()
                future = client.submit(work, item, pure=False)
                items[future.key] = item
                running.add(future)
            future = next(running)
            try:
                yield items.pop(future.key), future.result()
            except KilledWorker as error:
                raise WorkersError(f"Dask workers died again and again: {error}") from error
            except CancelledError:
                raise WorkersError(f"the Dask scheduler at {address} has gone") from None
            future.release()


def _with_item(work: Callable[[Item], Result], item: Item) -> tuple[Item, Result]:
    return item, work(item)


def follow_parent() -> None:
    """Leave Ctrl-C to the parent, and end when the parent does, even if it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
