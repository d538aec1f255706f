"""The warm-up: compile all that is compiled when it is first used, by some short drives."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from numba.core import event

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task
from foresee.infra.progress import progress
from foresee.mapping.kernels import PACKAGES, kernel_count, warm_mark

LONGEST = 6.0
"""Longest drive [s]."""


def warm_up() -> str:
    """Compile what is not compiled yet, with a progress bar, and return a line about it."""
    started, mark = time.perf_counter(), warm_mark()
    with progress(total=kernel_count(), desc="compiling", unit="kernel") as bar:
        with _counting(bar):
            for settings in _drives():
                task = make_task(settings, 0)
                task = replace(task, rules=replace(task.rules, time_limit=LONGEST))
                for arm in settings.arms:
                    drive(settings, 0, arm, task)
        count = bar.n
        # Some kernels belong to other commands, and are compiled there.
        bar.total = max(count, 1)
    if mark is not None:
        mark.touch()
    took = time.perf_counter() - started
    kept = "" if mark is not None else "; they cannot be kept, as no cache folder can be written"
    return f"{count} kernels compiled in {took:.0f} s{kept}"


def warm_up_if_cold() -> None:
    """Warm up with a line that says so, unless it was done before or nothing can be kept."""
    mark = warm_mark()
    if mark is None or mark.exists():
        return
    print("the kernels are compiled first, once for this machine and version", file=sys.stderr)
    print(warm_up(), file=sys.stderr)


def _drives() -> list[Settings]:
    """Return the settings of drives that together use all kernels of a comparison."""
    # The first seeds of validation.
    plain = Settings(seed=1000, episodes=1, arms=("predicted", "oracle"))
    with_errors = replace(plain, delay=0.1, jitter=0.02, lag=0.05, pose_error=0.02, yaw_error=0.01)
    return [
        plain,
        replace(with_errors, arms=("predicted",), route="fixed", noise=0.01),
        replace(plain, arms=("predicted",), world=("office",), vehicle="differential"),
    ]


@contextmanager
def _counting(bar: Any) -> Iterator[None]:
    """Advance a progress bar by one for each kernel that numba compiles in this context."""
    kernels = set[str]()

    class Counter(event.Listener):
        def on_start(self, event: Any) -> None:
            pass

        def on_end(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            # numba also compiles functions of its own, and a kernel for each kind of arguments.
            if name.startswith(PACKAGES) and name not in kernels:
                kernels.add(name)
                bar.update()

    with event.install_listener("numba:compile", Counter()):
        yield
