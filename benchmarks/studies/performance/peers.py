"""Comparison of the prediction's runtimes; the solvers of the MPC are compared in `peers_mpc`.

Calls of the runtimes take turns, a few calls each: other load of the machine then affects all
equally, and each has the caches to itself for a while.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.studies.performance.sized_maps import along, crops_along
from benchmarks.studies.performance.stage_times import OURS, beside_ours
from foresee.prediction import View
from predictor.compact import SHIPPED, Compact
from predictor.networks.compact_net import CompactNet
from predictor.weights import load_weights, save_weights
from sim.buildings import task_in

TOGETHER = 10
"""Number of consecutive calls of one library."""
REPEATS = 200
"""Number of timed calls of each function."""


def compare(calls: dict[str, Callable[[int], Any]], repeats: int) -> dict[str, dict[str, float]]:
    """Time some functions, which take turns of a few calls each.

    Each turn starts with a call that is not timed, which brings data back into the caches.

    Args:
        calls: name → function; `OURS` must be among the names.
        repeats: number of timed calls of each, with arguments 0, 1, …

    Returns:
        Times as in `beside_ours`.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for first in range(0, repeats, TOGETHER):
        for name, call in calls.items():
            call(first)
            for i in range(first, min(first + TOGETHER, repeats)):
                started = time.perf_counter()
                call(i)
                taken[name].append(1e3 * (time.perf_counter() - started))
    return beside_ours(taken)


def predictions(seed: int) -> dict[str, dict[str, float]]:
    """Time predictions of 10 m squares in a corridor: by the shipped network, and in other ways.

    They are the same network in floating-point numbers, and in PyTorch.
    """
    task = task_in("corridor", seed)
    crops, poses = crops_along(task, REPEATS), along(task, REPEATS)
    views = [View(crop, pose) for crop, pose in zip(crops, poses, strict=True)]
    net, facts = load_weights(SHIPPED, CompactNet)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "floats.safetensors"
        save_weights(path, net.with_ranges(None), facts)
        ways = {
            OURS: Compact(),
            "floating-point numbers": Compact(path),
            "PyTorch, eager": Compact(runtime="torch"),
            "PyTorch, eager, floating-point numbers": Compact(path, "torch"),
        }
    return compare({name: partial(_predict, way, views) for name, way in ways.items()}, REPEATS)


def _predict(way: Compact, views: list[View], number: int) -> Any:
    return way.predict(views[number])
