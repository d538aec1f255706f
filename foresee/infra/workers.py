"""Parallel work: in processes of this machine (joblib), or on the machines of a Dask cluster.

The results do not depend on the number of processes, only their order does.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from typing import Any, TypeVar
from urllib.parse import urlsplit

from foresee.infra.errors import LineError, one_line

# Set before a worker imports numpy, since the threads of its libraries would compete for the cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

Item = TypeVar("Item")
Result = TypeVar("Result")

SCHEMES = ("tcp", "tls", "ws", "wss")
"""Protocols of a Dask scheduler."""
PATIENCE = 10.0
"""Time for which a Dask scheduler is waited for [s]."""
DEATHS = 10
"""Consecutive deaths of worker processes, without a finished item, after which work is given up."""


class WorkersError(LineError):
    """The worker processes cannot do the work; the message is one line."""


class LostError(WorkersError):
    """Some items are not done, since their worker processes died repeatedly; all others are done.

    Attributes:
        items: items that are not done.
    """

    status = 1

    def __init__(self, items: Sequence[Any]) -> None:
        named = ", ".join(map(str, items[:5])) + (" …" if len(items) > 5 else "")
        super().__init__(
            f"not done, because their processes died again and again: {named}; "
            "give the same command again to retry"
        )
        self.items = items


def finished(
    work: Callable[[Item], Result], todo: list[Item], jobs: int, dask: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Do the work for each item in parallel, and yield each item with its result as it ends.

    Args:
        work: function of one item; it must be picklable, and should import heavy modules only when
            it is called.
        todo: items.
        jobs: number of worker processes; 1: this process does the work.
        dask: address of a Dask scheduler, whose workers are used instead of processes here.

    Raises:
        LostError: at the end, if the processes of some items died repeatedly.
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

    # Loky replaces a process that has grown by 300 MB, which loading a network may do.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    left = dict(enumerate(todo))
    deaths = 0
    try:
        # Items that were being worked on when a process died are suspects: they are tried again
        # after all others, and if a process dies again, one at a time.
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
        # Without this, the processes would live on for minutes and keep their memory.
        get_reusable_executor().shutdown(wait=False, kill_workers=True)
    if left:
        raise LostError(list(left.values()))


def _in_pool(
    work: Callable[[Item], Result], left: dict[int, Item], jobs: int
) -> Generator[tuple[Item, Result], None, dict[int, Item]]:
    """Do the work for items, and yield the results, until all are done or a process dies.

    Args:
        work: function of one item.
        left: number → item; items are removed as they are finished, and also those that were being
            worked on when a process died.
        jobs: number of worker processes.

    Returns:
        The items that were being worked on when a process died, by number; empty if none died.
    """
    from concurrent.futures.process import BrokenProcessPool

    from joblib import Parallel, delayed

    given = []

    def calls() -> Iterator[Any]:
        for number, item in list(left.items()):
            given.append(number)
            yield delayed(_numbered)(work, number, item)

    # At least two processes: with one, joblib would work in this process, which could then crash.
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
    # Dask's own interface, since joblib's waits for ever for an item that killed its workers.
    from concurrent.futures import CancelledError

    check_scheduler(address)
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise WorkersError("--dask needs Dask: pip install 'foresee-nav[dask]'") from None

    try:
        _await_greeting(address)
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TypeError, ValueError) as error:
        # Dask raises a TypeError if its configuration names no certificates for TLS.
        raise WorkersError(f"no Dask scheduler answers at {address}: {one_line(error)}") from None
    with client:
        if not client.nthreads():
            raise WorkersError(f"the Dask scheduler at {address} has no workers")
        waiting = list(reversed(todo))
        items: dict[Any, Item] = {}
        lost = []
        running = as_completed(loop=client.loop)
        while waiting or items:
            # Only as many as keep all workers busy, since there may be a million items.
            threads = client.nthreads()
            if not set(threads.values()) <= {1}:
                # OMPL has one random generator per process, so two drives in one would share it.
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
                # Dask raises this if the scheduler cannot import a package that the work needs.
                if "deserialization" not in str(error):
                    raise
                why = error.__cause__ or "another environment"
                raise WorkersError(
                    f"the Dask scheduler at {address} lacks packages: {why}"
                ) from error
            future.release()
    if lost:
        raise LostError(lost)


def check_scheduler(address: str) -> None:
    """Check the form of a Dask scheduler's address.

    Raises:
        WorkersError: if it is no address.
    """
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        right = parts.scheme in SCHEMES and parts.hostname and parts.port
        if right and parts.netloc == address.rpartition("://")[2]:
            return
    except ValueError:
        # The port is no number, or too large.
        pass
    raise WorkersError(
        f"{address!r} is no address of a Dask scheduler, such as tcp://10.0.0.1:8786: "
        f"{', '.join(SCHEMES)}, a host and a port"
    )


def _await_greeting(address: str) -> None:
    """Wait for the bytes that a scheduler sends to each client at once.

    Other servers, such as the scheduler's own dashboard, wait for a request, and Dask would take
    their answer for the length of a message and wait for ever.

    Raises:
        OSError: if the server cannot be reached, or sends nothing.
    """
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    if parts.scheme != "tcp":
        return
    # If there is no server yet, Dask waits for it.
    with (
        contextlib.suppress(ConnectionRefusedError),
        socket.create_connection((parts.hostname, parts.port), PATIENCE) as connection,
    ):
        try:
            connection.recv(1)
        except TimeoutError:
            raise OSError("another server, such as its dashboard, has this port") from None


def _numbered(work: Callable[[Item], Result], number: int, item: Item) -> tuple[int, Result]:
    return number, work(item)


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in processes that are started in this context; their parent ends them.

    Otherwise a process that is still importing modules would print a traceback.
    """
    # The resource tracker is started first, since its start unblocks the signal.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def follow_parent(parent: int) -> None:
    """Ignore Ctrl-C in this process, and end it when its parent ends, even by a kill.

    Args:
        parent: process number of the parent. The parent passes it, since it may already have ended
            when this process starts.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
