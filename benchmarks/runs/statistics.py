"""Intervals and tests for paired episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from benchmarks.runs.drive_result import DriveResult

Arms = dict[str, list[DriveResult]]
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


def bootstrap(
    worlds: Sequence[str],
    entries: NDArray[np.float64],
    statistic: Callable[[NDArray[np.float64]], Any],
    rounds: int = 2000,
) -> tuple[float, float]:
    """Compute the 95 % interval of a statistic of sums over episodes.

    Args:
        worlds: each episode's world, n of them; episodes of one world are drawn together.
        entries: what is summed, (k, n).
        statistic: of the sums of all resamplings, (k, rounds); one value for each, (rounds,).
        rounds: resamplings; their seed is fixed.
    """
    numbers: dict[str, int] = {}
    of = np.array([numbers.setdefault(world, len(numbers)) for world in worlds])
    count = len(numbers)
    parts = np.stack([np.bincount(of, entry, count) for entry in entries])
    rng = np.random.default_rng(0)
    drawn = (np.bincount(rng.integers(0, count, count), minlength=count) for _ in range(rounds))
    values = statistic(np.stack([parts @ times for times in drawn], axis=1))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(low), float(high)


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


def estimate(
    worlds: Sequence[str],
    entries: NDArray[np.float64],
    statistic: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> dict[str, Any]:
    """Compute a statistic of sums over episodes and its 95 % interval; see `bootstrap`.

    Returns:
        `value`, `low` and `high`; both ends are None with fewer than `MIN_WORLDS` distinct worlds,
        which say too little of others.
    """
    value = float(statistic(entries.sum(axis=1, keepdims=True))[0])
    low, high = None, None
    if len(set(worlds)) >= MIN_WORLDS:
        low, high = bootstrap(worlds, entries, statistic)
    return {"value": value, "low": low, "high": high}


def paired_speed(arms: Arms, arm: str) -> dict[str, Any]:
    """Compute an arm's speed, total length over total time, on paired episodes [m/s]."""
    return _of_speeds(arms, (arm,), lambda speeds: speeds[0])


def difference(arms: Arms, arm: str, baseline: str) -> dict[str, Any]:
    """Compute an arm's speed less that of a baseline, on the same episodes [m/s]."""
    return _of_speeds(arms, (arm, baseline), lambda speeds: speeds[0] - speeds[1])


def success(arms: Arms, arm: str) -> dict[str, Any] | None:
    """Compute SCT, success weighted by completion time (Yokoyama, Ha and Batra 2021).

    The mean over episodes of T_bound / time where the goal was reached, else of 0.

    Returns:
        None if no episode has one in every arm: results of older runs have none.
    """
    scored = _scored(arms)
    return _mean_difference(scored, arm) if scored[arm] else None


def time_ratio(arms: Arms, arm: str, baseline: str) -> dict[str, Any] | None:
    """Compute total time over that of a baseline, on the episodes that both reached.

    Returns:
        Its interval is over worlds; `episodes` says how many there are. None if there are none.
    """
    both = _reached(arms, (arm, baseline))
    if not both[arm]:
        return None
    times = np.array([[result.time for result in both[name]] for name in (arm, baseline)])
    ratio = estimate(_worlds(both), times, lambda sums: sums[0] / np.maximum(sums[1], 1e-9))
    return ratio | {"episodes": len(both[arm])}


def share_of_gap(arms: Arms) -> dict[str, Any] | None:
    """(predicted - known) / (oracle - known) in SCT, with its 95 % interval over worlds.

    Returns:
        None where the interval of the denominator reaches 0, from fewer than `MIN_WORLDS` worlds,
        and where arms or SCTs are missing.
    """
    if not arms.keys() >= set(GAP):
        return None
    scored = _scored(arms)
    if not scored["known"]:
        return None
    return _share(scored, "sct", _mean_difference(scored, "oracle", "known", "sct"))


def share_of_time(arms: Arms) -> dict[str, Any] | None:
    """(predicted - known) / (oracle - known) in time, over the episodes that all three reached.

    Only on a prescribed route: else a detour that prediction saves counts as driving faster.

    Returns:
        None where the interval of the denominator reaches 0, from fewer than `MIN_WORLDS` worlds,
        and where an arm is missing.
    """
    if not arms.keys() >= set(GAP):
        return None
    reached = _reached(arms, GAP)
    if not reached["known"]:
        return None
    return _share(reached, "time", _mean_difference(reached, "known", "oracle", "time"))


def _share(arms: Arms, key: str, gap: dict[str, Any]) -> dict[str, Any] | None:
    """Compute the share of the gap in one figure; `gap` is the lead of the oracle in it."""
    if gap["low"] is None or gap["low"] <= 0:
        return None

    def share(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        known, predicted, oracle = sums
        return np.asarray((predicted - known) / np.where(oracle == known, np.nan, oracle - known))

    values = np.array([[getattr(result, key) for result in arms[name]] for name in GAP])
    return estimate(_worlds(arms), values, share)


def _mean_difference(
    arms: Arms, arm: str, baseline: str | None = None, key: str = "sct"
) -> dict[str, Any]:
    """Compute an arm's mean of a figure, less that of a baseline if there is one."""
    values = np.array([getattr(result, key) for result in arms[arm]], dtype=np.float64)
    if baseline is not None:
        values = values - [getattr(result, key) for result in arms[baseline]]
    entries = np.stack([values, np.ones(len(values))])
    return estimate(_worlds(arms), entries, lambda sums: sums[0] / sums[1])


def _scored(arms: Arms) -> Arms:
    """Return only the episodes that have an SCT in every arm."""
    return _only(arms, lambda result: result.sct is not None)


def _reached(arms: Arms, names: tuple[str, ...]) -> Arms:
    """Return only some arms, and only the episodes that all of them reached."""
    chosen = {name: arms[name] for name in names}
    return _only(chosen, lambda result: result.outcome == "reached")


def _only(arms: Arms, wanted: Callable[[DriveResult], bool]) -> Arms:
    keep = [all(map(wanted, results)) for results in zip(*arms.values(), strict=True)]
    return {name: list(compress(results, keep)) for name, results in arms.items()}


def _worlds(arms: Arms) -> list[str]:
    return [result.world for result in next(iter(arms.values()))]


def _of_speeds(
    arms: Arms,
    names: tuple[str, ...],
    of_speeds: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> dict[str, Any]:
    # Of the speeds of some arms, (arms, resamplings).
    lengths = [[result.path_length for result in arms[name]] for name in names]
    times = [[result.time for result in arms[name]] for name in names]
    entries = np.array(lengths + times)

    def value(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        return of_speeds(sums[: len(names)] / np.maximum(sums[len(names) :], 1e-9))

    return estimate(_worlds(arms), entries, value)


def mcnemar(first: list[DriveResult], second: list[DriveResult], outcome: str) -> float:
    """Compute the exact two-sided p that two arms end in an outcome equally often."""
    pairs = list(zip(first, second, strict=True))
    a = sum(x.outcome == outcome != y.outcome for x, y in pairs)
    b = sum(y.outcome == outcome != x.outcome for x, y in pairs)
    return float(binomtest(a, a + b).pvalue) if a + b else 1.0


def realised_risk(results: Sequence[DriveResult]) -> dict[str, Any] | None:
    """Compute the share of broken promises, averaged over worlds; None without promises."""
    made = dict.fromkeys((r.world for r in results if r.promises), 0)
    broken = dict(made)
    for r in results:
        if r.world in made:
            made[r.world] += r.promises
            broken[r.world] += r.promises_broken
    if not made:
        return None
    shares = np.array([broken[world] / made[world] for world in made])
    return estimate(list(made), shares[None], lambda sums: sums[0] / len(shares))
