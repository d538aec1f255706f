"""How long things take: called again and again, or tick by tick in a drive."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings

OURS = "ours"
"""The name of this project's program among others."""
WARM_UP = 10
"""Ticks at the start of a drive that do not count: caches fill, the predictor is loaded."""


Measure = dict[str, Any]
"""A value with its unit and the number of its samples, and what tells how far it is to be
trusted: p99, or low and high."""


def measure(value: float, unit: str, samples: int, **bounds: float) -> Measure:
    """Return a measure, as it is written into the results."""
    return {"value": value, **bounds, "unit": unit, "samples": samples}


def spread(times: list[float] | NDArray[np.float64]) -> dict[str, float]:
    """Median, tails and number of some times [ms]."""
    p50, p95, p99 = np.percentile(times, [50, 95, 99])
    return {
        "median_ms": float(p50),
        "p95_ms": float(p95),
        "p99_ms": float(p99),
        "samples": len(times),
    }


def beside_ours(times: dict[str, list[float]]) -> dict[str, dict[str, float]]:
    """Return what is told of each program's times [ms].

    Returns:
        Name → median_ms, mean_ms, p99_ms and ratio: its median over that of `OURS`.
    """
    ours = float(np.median(times[OURS]))
    return {
        name: {
            "median_ms": float(np.median(taken)),
            "mean_ms": float(np.mean(taken)),
            "p99_ms": float(np.percentile(taken, 99)),
            "ratio": float(np.median(taken)) / ours,
        }
        for name, taken in times.items()
    }


def timed(call: Callable[[int], Any], repeats: int) -> dict[str, float]:
    """Return the spread of the times of `call(0)`, `call(1)`, …, after an uncounted one."""
    call(0)
    taken = []
    for i in range(repeats):
        started = time.perf_counter()
        call(i)
        taken.append(1e3 * (time.perf_counter() - started))
    return spread(taken)


def closed_loop(arm: str, drives: int, seed: int, v_max: float = 4.0) -> dict[str, list[float]]:
    """Time each stage [ms], tick by tick, over drives through corridors.

    Args:
        arm: what the car may know, of `benchmarks.runs.settings`.
        drives: how many count; one before them does not.
        seed: of the first.
        v_max: top speed [m/s].
    """
    settings = Settings(arms=(arm,), seed=seed, v_max=v_max)
    times: dict[str, list[float]] = {}
    for index in range(-1, drives):
        _, trace = drive(settings, max(index, 0), arm)
        prefix = f"e{max(index, 0)}/{arm}/"
        if index < 0:
            continue
        for column, name in enumerate(trace[prefix + "time_names"].tolist()):
            taken = trace[prefix + "times"][WARM_UP:, column]
            # A path is not planned in every tick.
            times.setdefault(name, []).extend(taken[taken > 0.0].tolist())
    return times
