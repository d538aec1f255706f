"""Bootstrap intervals of statistics of sums over groups, such as over buildings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Statistic = Callable[[NDArray[np.float64]], Any]
"""Function from sums, (k, rounds), to the value for each round, (rounds,)."""
ROUNDS = 2000
"""Number of resamplings."""
MIN_GROUPS = 5
"""Smallest number of different groups for which `estimate` gives an interval."""


def resampled(
    strata: Sequence[NDArray[np.float64]], rounds: int = ROUNDS, *, one_by_one: bool = False
) -> NDArray[np.float64]:
    """Resample groups within strata, and return the sums over all groups, (k, rounds).

    The seed is fixed, so that two statistics are compared on the same resamplings.

    Args:
        strata: for each stratum, the sums of each of its groups, (k, groups).
        rounds: number of resamplings.
        one_by_one: whether groups are drawn one by one rather than their numbers at once. Both have
            the same distribution; published intervals were computed with either.
    """
    rng = np.random.default_rng(0)
    totals = np.zeros((len(strata[0]), rounds))
    for sums in strata:
        count = sums.shape[1]
        if one_by_one:
            drawn = rng.integers(0, count, (rounds, count))
            times = (np.bincount(groups, minlength=count) for groups in drawn)
            totals += np.stack([sums @ number for number in times], axis=1)
        else:
            totals += sums @ rng.multinomial(count, np.full(count, 1.0 / count), rounds).T
    return totals


def ends(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 2.5th and the 97.5th percentile of resampled values; NaN values do not count."""
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(low), float(high)


def estimate(
    groups: Sequence[str],
    entries: NDArray[np.float64],
    statistic: Statistic,
    rounds: int = ROUNDS,
) -> dict[str, Any]:
    """Compute a statistic of sums over entries and its 95 % bootstrap interval.

    Args:
        groups: group of each entry, n of them; the entries of a group are drawn together.
        entries: k values of each entry that are summed, (k, n).
        statistic: function of the sums.
        rounds: number of resamplings.

    Returns:
        `value`, `low` and `high`; both ends are None with fewer than `MIN_GROUPS` different groups.
    """
    numbers: dict[str, int] = {}
    number = np.array([numbers.setdefault(group, len(numbers)) for group in groups])
    value = float(statistic(entries.sum(axis=1, keepdims=True))[0])
    low, high = None, None
    if len(numbers) >= MIN_GROUPS:
        sums = _sums(number, entries)
        low, high = ends(statistic(resampled([sums], rounds, one_by_one=True)))
    return {"value": value, "low": low, "high": high}


def grouped_mean(
    groups: NDArray[np.int64], sums: NDArray[np.float64], weights: NDArray[np.float64]
) -> dict[str, Any] | None:
    """Compute a weighted mean and its 95 % bootstrap interval.

    Args:
        groups: group of each entry, (n,); the entries of a group are drawn together.
        sums: value times weight of each entry, (n,); NaN: the entry does not count.
        weights: weight of each entry, (n,).

    Returns:
        `value`, `low`, `high`, and `groups`, the number of groups. Both ends are None for a single
        group. None if no entry has a weight.
    """
    counted = np.isfinite(sums) & (weights > 0)
    if not counted.any():
        return None
    names, number = np.unique(groups[counted], return_inverse=True)
    parts = _sums(number, np.stack([sums, weights])[:, counted])
    low, high = None, None
    if len(names) > 1:
        top, bottom = resampled([parts])
        low, high = ends(top / bottom)
    total = parts.sum(axis=1)
    return {"value": float(total[0] / total[1]), "low": low, "high": high, "groups": len(names)}


def _sums(number: NDArray[np.intp], entries: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of the entries (k, n) of each group, (k, groups)."""
    return np.stack([np.bincount(number, entry) for entry in entries])
