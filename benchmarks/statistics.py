"""Intervals and tests for paired episodes."""

from __future__ import annotations

import math
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


def speed(results: Sequence[Result]) -> float:
    """Σ path length / Σ time [m/s]."""
    return sum(r["path_length"] for r in results) / max(sum(r["time"] for r in results), 1e-9)


def bootstrap(
    worlds: Sequence[str],
    statistic: Callable[[NDArray[np.int64]], float],
    rounds: int = 2000,
) -> tuple[float, float]:
    """95 % interval of a statistic of episodes, resampled by world.

    Args:
        worlds: each episode's world; episodes of one world are drawn together.
        statistic: of the episodes' numbers (n,), repeats included.
        rounds: resamplings; their seed is fixed.
    """
    groups: dict[str, list[int]] = {}
    for i, world in enumerate(worlds):
        groups.setdefault(world, []).append(i)
    members = [np.array(group) for group in groups.values()]
    rng = np.random.default_rng(0)
    values = []
    for _ in range(rounds):
        drawn = rng.integers(0, len(members), len(members))
        values.append(statistic(np.concatenate([members[j] for j in drawn])))
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
    """An arm's speed over all paired episodes, with its interval over worlds [m/s]."""
    results = arms[arm]
    length = np.array([r["path_length"] for r in results])
    time = np.array([r["time"] for r in results])
    low, high = bootstrap(
        [r["world"] for r in results], lambda i: float(length[i].sum() / time[i].sum())
    )
    return {"value": speed(results), "low": low, "high": high}


def difference(arms: dict[str, list[Result]], arm: str, baseline: str) -> dict[str, Any]:
    """Speed of an arm less that of a baseline, on the same episodes [m/s]."""
    a, b = _sums(arms[arm]), _sums(arms[baseline])

    def value(i: NDArray[np.int64]) -> float:
        return float(a[0][i].sum() / a[1][i].sum() - b[0][i].sum() / b[1][i].sum())

    worlds = [r["world"] for r in arms[arm]]
    low, high = bootstrap(worlds, value)
    return {"value": value(np.arange(len(worlds))), "low": low, "high": high}


def share_of_gap(arms: dict[str, list[Result]]) -> dict[str, Any] | None:
    """(v_predicted - v_known) / (v_oracle - v_known), or None where there is no gap to share.

    None, too, where the interval of the denominator contains 0.
    """
    if not {"known", "predicted", "oracle"} <= arms.keys():
        return None
    if difference(arms, "oracle", "known")["low"] <= 0:
        return None
    sums = {name: _sums(arms[name]) for name in ("known", "predicted", "oracle")}

    def value(i: NDArray[np.int64]) -> float:
        v = {n: float(s[0][i].sum() / s[1][i].sum()) for n, s in sums.items()}
        gap = v["oracle"] - v["known"]
        return (v["predicted"] - v["known"]) / gap if gap else math.nan

    worlds = [r["world"] for r in arms["known"]]
    low, high = bootstrap(worlds, value)
    return {"value": value(np.arange(len(worlds))), "low": low, "high": high}


def mcnemar(first: list[Result], second: list[Result], outcome: str) -> float:
    """Exact two-sided p that two arms end in an outcome equally often, on paired episodes."""
    pairs = list(zip(first, second, strict=True))
    a = sum(x["outcome"] == outcome != y["outcome"] for x, y in pairs)
    b = sum(y["outcome"] == outcome != x["outcome"] for x, y in pairs)
    return float(binomtest(a, a + b).pvalue) if a + b else 1.0


def realised_risk(results: Sequence[Result]) -> float | None:
    """Mean over worlds of the share of relying ticks whose promise broke; None if none relied."""
    worlds: dict[str, list[int]] = {}
    for r in results:
        entry = worlds.setdefault(r["world"], [0, 0])
        entry[0] += r["promises_broken"]
        entry[1] += r["promises"]
    shares = [broken / made for broken, made in worlds.values() if made]
    return float(np.mean(shares)) if shares else None


def _sums(results: list[Result]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return (
        np.array([r["path_length"] for r in results]),
        np.array([r["time"] for r in results]),
    )
