"""Work spread over processes by joblib, or over the machines of a Dask cluster.

The results are those of one thing after the other, whoever did them.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from predictor.infra.errors import LineError

# Before a worker imports numpy: threads of its libraries would fight over the cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

Item = TypeVar("Item")
Result = TypeVar("Result")

DEATHS = 10
"""How often processes may die with nothing finished between, before what is left is given up."""


class WorkersError(LineError):
    """Nobody is there to do the work; the message is one line."""


class LostError(WorkersError):
    """Some things are left undone, for each process died that did them; all others are done.

    Attributes:
        items: these things.
    """

    def __init__(self, items: Sequence[Any]) -> None:
        named = ", ".join(map(str, items[:5])) + (" …" if len(items) > 5 else "")
        super().__init__(f"left undone, for processes died again and again: {named}")
        self.items = items


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
        LostError: at the end, if some things kill each process that does them.
        WorkersError: if there are no workers, or their scheduler lacks a package.
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
    from joblib.externals.loky import get_reusable_executor

    left = dict(enumerate(todo))
    deaths = 0
    try:
        # What was under way when a process died is done when all else is; what was so again, alone.
        for alone in (False, False, True):
            suspects: dict[int, Item] = {}
            for part in [{number: item} for number, item in left.items()] if alone else [left]:
                while part and deaths < DEATHS:
                    before = len(part)
                    under_way = yield from _in_pool(work, part, jobs)
                    deaths = 0 if before > len(part) + len(under_way) else deaths + 1
                    suspects |= under_way
                suspects |= part
            left = suspects
    finally:
        # Else they stay for minutes, and keep their memory.
        get_reusable_executor().shutdown(wait=False, kill_workers=True)
    if left:
        raise LostError(list(left.values()))


def _in_pool(
    work: Callable[[Item], Result], left: dict[int, Item], jobs: int
) -> Generator[tuple[Item, Result], None, dict[int, Item]]:
    """Do things and take them out, until a process dies; take out what was under way, return it."""
    from concurrent.futures.process import BrokenProcessPool

    from joblib import Parallel, delayed

    given = []

    def calls() -> Iterator[Any]:
        for number, item in list(left.items()):
            given.append(number)
            yield delayed(_numbered)(work, number, item)

    # Two at least: joblib would do a single thing in this process, and die of it.
    pool = Parallel(
        max(2, min(jobs, len(left))),
        "loky",
        return_as="generator_unordered",
        batch_size=1,
        initializer=partial(follow_parent, os.getpid()),
    )
    try:
        with interrupts_blocked():
            results = pool(calls())
        for number, result in results:
            yield left.pop(number), result
    except BrokenProcessPool:
        # A native library crashed one process, and the pool with it.
        return {number: left.pop(number) for number in given if number in left}
    return {}


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
        lost = []
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
            item = items.pop(future.key)
            try:
                yield item, future.result()
            except KilledWorker:
                lost.append(item)
            except CancelledError:
                raise WorkersError(f"the Dask scheduler at {address} has gone") from None
            except RuntimeError as error:
                # Dask's own, of a scheduler that cannot import what is asked for.
                if "deserialization" not in str(error):
                    raise
                why = error.__cause__ or "another environment"
                raise WorkersError(
                    f"the Dask scheduler at {address} lacks packages: {why}"
                ) from error
            future.release()
    if lost:
        raise LostError(lost)


def _numbered(work: Callable[[Item], Result], number: int, item: Item) -> tuple[int, Result]:
    return number, work(item)


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C for the processes that are started meanwhile: their parent ends them.

    A process that is still importing would print a traceback.
    """
    # Started first, since its start unblocks the signal.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def follow_parent(parent: int) -> None:
    """Leave Ctrl-C to the parent, and end when the parent does, even if it was killed.

    Args:
        parent: process number of the parent, told by itself: it may be gone by now.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
