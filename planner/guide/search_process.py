"""A process of its own for path searches, which can neither delay nor end the planner's process."""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import signal
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from multiprocessing.util import Finalize
from threading import Timer
from typing import Any

from foresee.infra.workers import follow_parent, interrupts_blocked

LONGEST = 20.0
"""Time after which a search counts as stuck [s]; on a busy machine one may take a few seconds."""


class SearchProcess(Executor):
    """Runs path searches in a process, one after the other.

    Several navigators may use it in turn. A process whose search takes longer than `LONGEST` is
    killed. If the process dies, the search fails, and the next one starts another process. It ends
    with this process, even if that is killed, or by `shutdown`.

    A process and not a thread, since a search holds the interpreter's lock for long, above all in
    OMPL, which calls back into Python.
    """

    def __init__(self) -> None:
        self._pools = [_new_pool()]
        # A process of multiprocessing waits at its end for those that it has started.
        Finalize(self, _end, (self._pools,), exitpriority=10)
        self._loaded = self._load()
        # The control would wait for the first path while the process imports its modules.
        self._loaded.result()

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Start a call, whose arguments must be picklable, and return its future.

        The caller may change the arguments as soon as this returns.
        """
        from joblib.externals.loky.backend.reduction import dumps

        # The pool would pickle them later, in a thread, while the caller's next tick adds what it
        # has computed to the same maps.
        pickled = bytes(dumps((call, args, kwargs)))
        try:
            future: Future[Any] = self._pools[0].submit(_call, pickled)
        except BrokenExecutor:
            self._pools[0] = _new_pool()
            self._loaded = self._load()
            future = self._pools[0].submit(_call, pickled)
        watch = Timer(LONGEST, _kill_if_stuck, (future, self._loaded, self._pools[0]))
        watch.daemon = True
        watch.start()
        future.add_done_callback(lambda _: watch.cancel())
        return future

    def _load(self) -> Future[None]:
        """Start the process, and let it import what a search needs."""
        with interrupts_blocked():
            loaded: Future[None] = self._pools[0].submit(_load)
        return loaded

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the process, also while it searches."""
        _end(self._pools)


def _new_pool() -> Any:
    # Not Python's own pool, which would run the user's script again in each new process.
    from joblib.externals.loky.backend import get_context
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    follow = partial(follow_parent, os.getpid())
    return ProcessPoolExecutor(1, context=get_context("loky"), initializer=follow)


def _end(pools: list[Any]) -> None:
    """End the process of a list of one pool."""
    pools[0].shutdown(kill_workers=True)


def _call(pickled: bytes) -> Any:
    """Make a call, given as the function and its arguments, pickled."""
    call, args, kwargs = pickle.loads(pickled)
    return call(*args, **kwargs)


def _load() -> None:
    """Import what a search needs."""
    for name in ("ompl.base", "planner.guide.path_search"):
        importlib.import_module(name)


def _kill_if_stuck(search: Future[Any], loaded: Future[None], pool: Any) -> None:
    """Kill the process of a search that has not ended, so that it fails."""
    if not search.done() and loaded.done():
        # The present process: the pool replaces one that has grown.
        for number in tuple(pool._processes):
            with contextlib.suppress(OSError):
                os.kill(number, signal.SIGKILL)
