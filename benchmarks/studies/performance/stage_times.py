"""Timing of repeated calls, and of the stages of each tick in drives."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.drive import drive
from benchmarks.runs.settings import Settings

OURS = "ours"
"""Name of this project in comparisons with other libraries."""
WARM_UP = 10
"""Number of ticks at the start of a drive that are not counted: caches fill, and the predictor is
loaded."""


Measure = dict[str, Any]
"""A result: `value`, `unit`, number of `samples`, and its spread, `p99`, or `low` and `high`."""


def measure(value: float, unit: str, samples: int, **bounds: float) -> Measure:
    """Return a measure as it is written into the results.

    Args:
        value: value.
        unit: unit of the value.
        samples: number of samples.
        bounds: `p99`, or `low` and `high`.
    """
    return {"value": value, **bounds, "unit": unit, "samples": samples}


def spread(times: list[float] | NDArray[np.float64]) -> dict[str, float]:
    """Return the median and the upper percentiles of some times [ms], and their number."""
    p50, p95, p99 = np.percentile(times, [50, 95, 99])
    return {
        "median_ms": float(p50),
        "p95_ms": float(p95),
        "p99_ms": float(p99),
        "samples": len(times),
    }


def beside_ours(times: dict[str, list[float]]) -> dict[str, dict[str, float]]:
    """Return statistics of the times [ms] of each library.

    Returns:
        Name → `median_ms`, `p99_ms`, and `ratio`, its median divided by that of `OURS`.
    """
    spreads = {name: spread(taken) for name, taken in times.items()}
    ours = spreads[OURS]["median_ms"]
    return {
        name: {
            "median_ms": of["median_ms"],
            "p99_ms": of["p99_ms"],
            "ratio": of["median_ms"] / ours,
        }
        for name, of in spreads.items()
    }


def timed(call: Callable[[int], Any], repeats: int) -> dict[str, float]:
    """Time `call(0)`, `call(1)`, … after one call that is not timed; return their `spread`."""
    call(0)
    taken = []
    for i in range(repeats):
        started = time.perf_counter()
        call(i)
        taken.append(1e3 * (time.perf_counter() - started))
    return spread(taken)


def closed_loop(arm: str, drives: int, seed: int) -> dict[str, list[float]]:
    """Time each stage in each tick of drives through corridors.

    Args:
        arm: arm, a key of `benchmarks.runs.arms.ARMS`.
        drives: number of drives that are counted; one before them is not.
        seed: seed of the first drive.

    Returns:
        Stage → its times [ms].
    """
    settings = Settings(arms=(arm,), seed=seed)
    times: dict[str, list[float]] = {}
    drive(settings, 0, arm)
    for index in range(drives):
        for name, taken in drive(settings, index, arm).trace.stage_times(WARM_UP).items():
            times.setdefault(name, []).extend(taken.tolist())
    return times
