"""Intervals and tests for paired episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

Result = dict[str, Any]


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson interval of a share."""
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
    """95 % interval of a statistic of sums over episodes, resampled by world.

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
    """A weighted mean with its 95 % interval, groups resampled; None without any weight.

    One group says nothing of others: then the interval's ends are None.

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


def paired_speed(arms: dict[str, list[Result]], arm: str) -> dict[str, Any]:
    """Σ path length / Σ time of an arm over all paired episodes, interval over worlds [m/s]."""
    return _interval(arms, (arm,), lambda speeds: speeds[0])


def difference(arms: dict[str, list[Result]], arm: str, baseline: str) -> dict[str, Any]:
    """Speed of an arm less that of a baseline, on the same episodes [m/s]."""
    return _interval(arms, (arm, baseline), lambda speeds: speeds[0] - speeds[1])


def share_of_gap(arms: dict[str, list[Result]]) -> dict[str, Any] | None:
    """(v_predicted - v_known) / (v_oracle - v_known), or None where there is no gap to share.

    None, too, where the interval of the denominator contains 0.
    """
    names = ("known", "predicted", "oracle")
    if not arms.keys() >= set(names) or difference(arms, "oracle", "known")["low"] <= 0:
        return None

    def share(speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        known, predicted, oracle = speeds
        gap = np.where(oracle == known, np.nan, oracle - known)
        return np.asarray((predicted - known) / gap)

    return _interval(arms, names, share)


def _interval(
    arms: dict[str, list[Result]],
    names: tuple[str, ...],
    of_speeds: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> dict[str, Any]:
    # Of the speeds of some arms, (arms, resamplings).
    entries = np.array([
        [result[key] for result in arms[name]] for key in ("path_length", "time") for name in names
    ])  # fmt: skip

    def value(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        return of_speeds(sums[: len(names)] / np.maximum(sums[len(names) :], 1e-9))

    low, high = bootstrap([result["world"] for result in arms[names[0]]], entries, value)
    return {"value": float(value(entries.sum(axis=1, keepdims=True))[0]), "low": low, "high": high}


def mcnemar(first: list[Result], second: list[Result], outcome: str) -> float:
    """Exact two-sided p that two arms end in an outcome equally often, on paired episodes."""
    pairs = list(zip(first, second, strict=True))
    a = sum(x["outcome"] == outcome != y["outcome"] for x, y in pairs)
    b = sum(y["outcome"] == outcome != x["outcome"] for x, y in pairs)
    return float(binomtest(a, a + b).pvalue) if a + b else 1.0


def realised_risk(results: Sequence[Result]) -> dict[str, Any] | None:
    """Mean over worlds of the share of relying ticks whose promise broke; None if none relied."""
    made = dict.fromkeys((r["world"] for r in results if r["promises"]), 0)
    broken = dict(made)
    for r in results:
        if r["world"] in made:
            made[r["world"]] += r["promises"]
            broken[r["world"]] += r["promises_broken"]
    if not made:
        return None
    shares = np.array([broken[world] / made[world] for world in made])
    low, high = bootstrap(list(made), shares[None], lambda sums: sums[0] / len(shares))
    return {"value": float(shares.mean()), "low": low, "high": high}
