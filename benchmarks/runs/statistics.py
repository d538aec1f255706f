"""Intervals and tests for paired episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from benchmarks.runs.drive_result import DriveResult

ResultsByArm = dict[str, list[DriveResult]]
"""arm → its results on the paired episodes, in one order."""

MIN_WORLDS = 5
"""An interval over worlds is given from no fewer distinct ones."""
GAP = ("known", "predicted", "oracle")
"""Arms whose gap is shared."""


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Compute the 95 % Wilson interval of a share."""
    if trials == 0:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def estimate(
    worlds: Sequence[str],
    entries: NDArray[np.float64],
    statistic: Callable[[NDArray[np.float64]], Any],
    rounds: int = 2000,
) -> dict[str, Any]:
    """Compute a statistic of sums over episodes and its 95 % bootstrap interval.

    Args:
        worlds: each episode's world, n of them; episodes of one world are drawn together.
        entries: what is summed, (k, n).
        statistic: of the sums of all resamplings, (k, rounds); one value for each, (rounds,).
        rounds: resamplings; their seed is fixed.

    Returns:
        `value`, `low` and `high`; both ends are None with fewer than `MIN_WORLDS` distinct worlds,
        which say too little of others.
    """
    value = float(statistic(entries.sum(axis=1, keepdims=True))[0])
    numbers: dict[str, int] = {}
    of = np.array([numbers.setdefault(world, len(numbers)) for world in worlds])
    count = len(numbers)
    if count < MIN_WORLDS:
        return {"value": value, "low": None, "high": None}
    parts = np.stack([np.bincount(of, entry, count) for entry in entries])
    rng = np.random.default_rng(0)
    drawn = (np.bincount(rng.integers(0, count, count), minlength=count) for _ in range(rounds))
    values = statistic(np.stack([parts @ times for times in drawn], axis=1))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return {"value": value, "low": float(low), "high": float(high)}


def grouped_mean(
    groups: NDArray[np.int64],
    sums: NDArray[np.float64],
    weights: NDArray[np.float64],
    rounds: int = 2000,
) -> dict[str, Any] | None:
    """Compute a weighted mean and its 95 % interval by resampling groups.

    Without any weight the result is None. One group says nothing of others: then the ends of the
    interval are None.

    Args:
        groups: to which each entry belongs, (n,); those of one group are drawn together.
        sums: of what is averaged, times the weight, (n,); where it is NaN, there is no entry.
        weights: (n,).
        rounds: resamplings; their seed is fixed, so that two means are compared on the same ones.
    """
    there = np.isfinite(sums) & (weights > 0)
    if not there.any():
        return None
    _, of = np.unique(groups[there], return_inverse=True)
    count = int(of.max()) + 1
    parts = np.stack([np.bincount(of, values[there]) for values in (sums, weights)])
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), rounds)
    top, bottom = parts @ drawn.T
    ends = np.percentile(top / bottom, [2.5, 97.5]).tolist() if count > 1 else [None, None]
    total = parts.sum(axis=1)
    return {"value": float(total[0] / total[1]), "low": ends[0], "high": ends[1], "groups": count}


def mean_speed(arms: ResultsByArm, arm: str, baseline: str | None = None) -> dict[str, Any]:
    """Compute an arm's speed, total length over total time, less that of a baseline [m/s]."""
    names = (arm,) if baseline is None else (arm, baseline)
    entries = np.concatenate([_values(arms, key, *names) for key in ("path_length", "time")])

    def value(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        lengths, times = np.split(sums, 2)
        speeds = lengths / np.maximum(times, 1e-9)
        return np.asarray(speeds[0] if baseline is None else speeds[0] - speeds[1])

    return estimate(_worlds(arms), entries, value)


def success(arms: ResultsByArm, arm: str) -> dict[str, Any] | None:
    """Compute SCT, success weighted by completion time (Yokoyama, Ha and Batra 2021).

    The mean over episodes of T_bound / time where the goal was reached, else of 0.

    Returns:
        None if no episode has one in every arm: results of older runs have none.
    """
    scored = _scored(arms)
    return _mean(scored, _values(scored, "sct", arm)[0]) if scored[arm] else None


def time_ratio(arms: ResultsByArm, arm: str, baseline: str) -> dict[str, Any] | None:
    """Compute total time over that of a baseline, on the episodes that both reached.

    Returns:
        Its interval is over worlds; `episodes` says how many there are. None if there are none.
    """
    both = reached(arms, (arm, baseline))
    if not both[arm]:
        return None
    times = _values(both, "time", arm, baseline)
    ratio = estimate(_worlds(both), times, lambda sums: sums[0] / np.maximum(sums[1], 1e-9))
    return ratio | {"episodes": len(both[arm])}


def share_of_gap(arms: ResultsByArm, key: str) -> dict[str, Any] | None:
    """(predicted - known) / (oracle - known) in one figure, with its 95 % interval over worlds.

    Args:
        arms: their results.
        key: "sct"; or "time", over the episodes that all three reached. Time is for prescribed
            routes only: else a detour that prediction saves counts as driving faster.

    Returns:
        None where the interval of the denominator reaches 0, from fewer than `MIN_WORLDS` worlds,
        and where arms or figures are missing.
    """
    if not arms.keys() >= set(GAP):
        return None
    kept = _scored(arms) if key == "sct" else reached(arms, GAP)
    if not kept["known"]:
        return None
    values = _values(kept, key, *GAP)
    lead = values[2] - values[0] if key == "sct" else values[0] - values[2]
    low = _mean(kept, lead)["low"]
    if low is None or low <= 0:
        return None

    def share(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        known, predicted, oracle = sums
        return np.asarray((predicted - known) / np.where(oracle == known, np.nan, oracle - known))

    return estimate(_worlds(kept), values, share)


def _values(arms: ResultsByArm, key: str, *names: str) -> NDArray[np.float64]:
    """Return a figure of some arms, (arms, episodes)."""
    return np.array([[getattr(r, key) for r in arms[name]] for name in names], dtype=np.float64)


def _mean(arms: ResultsByArm, values: NDArray[np.float64]) -> dict[str, Any]:
    """Compute the mean of values over the episodes of some arms, (episodes,)."""
    entries = np.stack([values, np.ones(len(values))])
    return estimate(_worlds(arms), entries, lambda sums: sums[0] / sums[1])


def _scored(arms: ResultsByArm) -> ResultsByArm:
    """Return only the episodes that have an SCT in every arm."""
    return _only(arms, lambda result: result.sct is not None)


def reached(arms: ResultsByArm, names: tuple[str, ...]) -> ResultsByArm:
    """Return some arms alone, with those episodes in which all of them reached the goal."""
    chosen = {name: arms[name] for name in names}
    return _only(chosen, lambda result: result.outcome == "reached")


def _only(arms: ResultsByArm, wanted: Callable[[DriveResult], bool]) -> ResultsByArm:
    keep = [all(map(wanted, results)) for results in zip(*arms.values(), strict=True)]
    return {name: list(compress(results, keep)) for name, results in arms.items()}


def _worlds(arms: ResultsByArm) -> list[str]:
    return [result.world for result in next(iter(arms.values()))]


def mcnemar(first: list[DriveResult], second: list[DriveResult], outcome: str) -> float:
    """Compute the exact two-sided p that two arms end in an outcome equally often."""
    pairs = list(zip(first, second, strict=True))
    a = sum(x.outcome == outcome != y.outcome for x, y in pairs)
    b = sum(y.outcome == outcome != x.outcome for x, y in pairs)
    return float(binomtest(a, a + b).pvalue) if a + b else 1.0


def realised_risk(results: Sequence[DriveResult]) -> dict[str, Any] | None:
    """Compute the share of broken promises, averaged over worlds; None without promises."""
    made, broken = Counter[str](), Counter[str]()
    for r in results:
        if r.promises:
            made[r.world] += r.promises
            broken[r.world] += r.promises_broken
    if not made:
        return None
    shares = np.array([[broken[world] / made[world] for world in made]])
    return estimate(list(made), shares, lambda sums: sums[0] / len(made))
