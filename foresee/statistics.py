"""Confidence intervals of statistics of sums over groups, such as over buildings.

Intervals are symmetric studentised bootstrap intervals (Hall 1988, "On symmetric bootstrap
confidence intervals"): value ± q · s, with the jackknife's standard error s, and the 95 % quantile
q of |value* - value| / s* over resamplings, each with a standard error s* of its own. For time
ratios as skewed as those of published drives, 93 to 95 % of such intervals over 20 buildings hold
the true ratio, of BCa and percentile intervals 80 to 92 %: few drives, those that took a wrong
turn, decide the ratio. `tests/foresee/test_intervals.py` repeats the simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

Statistic = Callable[[NDArray[np.float64]], Any]
"""Function from sums, (k, n), to the value for each of n sums, (n,)."""
ROUNDS = 2000
"""Number of resamplings."""
MIN_GROUPS = 20
"""Smallest number of different groups for which an interval is given."""
TOGETHER = 2_000_000
"""Number of sums that are held in memory at a time."""
CONFIDENCE = 0.95
"""Confidence of all intervals."""


def interval(
    strata: Sequence[NDArray[np.float64]],
    statistic: Statistic,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[float, float] | None:
    """Compute the 95 % interval of a statistic of the sums over all groups.

    The seed is fixed, so that two statistics are compared on the same resamplings.

    Args:
        strata: for each stratum, the sums of each of its groups, (k, groups); groups are resampled
            within strata.
        statistic: function of the sums over all groups.
        bounds: smallest and largest possible value of the statistic.

    Returns:
        Both ends. None if there are fewer than `MIN_GROUPS` groups, or fewer than two in a stratum;
        if the value is the same whichever group is left out; or if so few groups differ from the
        others that many resamplings contain none of them. Such groups say nothing about the spread.
    """
    counts = [sums.shape[1] for sums in strata]
    if sum(counts) < MIN_GROUPS or min(counts) < 2:
        return None
    once = [np.ones((count, 1)) for count in counts]
    (value,), (error,) = next(_studentised(strata, statistic, once))
    if not error > 1e-12 * abs(value):
        return None
    rng = np.random.default_rng(0)
    drawn = [rng.multinomial(count, np.full(count, 1.0 / count), ROUNDS).T for count in counts]
    with np.errstate(divide="ignore", invalid="ignore"):
        scores = [abs(v - value) / s for v, s in _studentised(strata, statistic, drawn)]
    # A resampling without a spread or without a value says that the interval could be of any width.
    every = np.nan_to_num(np.concatenate(scores), nan=np.inf, posinf=np.inf)
    half = float(np.quantile(every, CONFIDENCE, method="higher")) * error
    if not np.isfinite(half):
        return None
    return max(float(value - half), bounds[0]), min(float(value + half), bounds[1])


def standard_error(strata: Sequence[NDArray[np.float64]], statistic: Statistic) -> float:
    """Compute the jackknife's standard error of a statistic of the sums over all groups.

    Args:
        strata: for each stratum, the sums of each of its groups, (k, groups), at least two.
        statistic: function of the sums over all groups.
    """
    once = [np.ones((sums.shape[1], 1)) for sums in strata]
    _, (error,) = next(_studentised(strata, statistic, once))
    return float(error)


def _studentised(
    strata: Sequence[NDArray[np.float64]],
    statistic: Statistic,
    times: Sequence[NDArray[Any]],
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield a statistic of resamplings and its jackknife standard errors, (rounds,) each, in parts.

    Args:
        strata: for each stratum, the sums of each of its groups, (k, groups).
        statistic: function of the sums over all groups.
        times: for each stratum, how often each group was drawn, (groups, rounds).
    """
    kinds, most = len(strata[0]), max(sums.shape[1] for sums in strata)
    size = max(1, TOGETHER // (kinds * most))
    for start in range(0, times[0].shape[1], size):
        part = [drawn[:, start : start + size].astype(np.float64) for drawn in times]
        total = np.sum([sums @ drawn for sums, drawn in zip(strata, part, strict=True)], axis=0)
        variance = np.zeros(total.shape[1])
        for sums, drawn in zip(strata, part, strict=True):
            count, rounds = drawn.shape
            without = (total[:, :, None] - sums[:, None, :]).reshape(kinds, -1)
            values = np.asarray(statistic(without), dtype=np.float64).reshape(rounds, count)
            # A group that was not drawn cannot be left out.
            values = np.where(drawn.T > 0, values, 0.0)
            mean = (drawn.T * values).sum(axis=1, keepdims=True) / count
            spread = (drawn.T * (values - mean) ** 2).sum(axis=1)
            variance += (count - 1) / count * spread
        yield np.asarray(statistic(total), dtype=np.float64), np.sqrt(variance)


def estimate(
    groups: Sequence[Any] | NDArray[Any],
    entries: NDArray[np.float64],
    statistic: Statistic,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> dict[str, Any]:
    """Compute a statistic of sums over entries and its 95 % interval.

    Args:
        groups: group of each entry, n of them; the entries of a group are drawn together.
        entries: k values of each entry that are summed, (k, n).
        statistic: function of the sums.
        bounds: smallest and largest possible value of the statistic.

    Returns:
        `value`, `low` and `high`, and `groups`, the number of different groups; both ends are None
        if `interval` gives none.
    """
    sums = _sums(groups, entries)
    ends = interval([sums], statistic, bounds) or (None, None)
    value = float(statistic(sums.sum(axis=1, keepdims=True))[0])
    return {"value": value, "low": ends[0], "high": ends[1], "groups": sums.shape[1]}


def grouped_mean(
    groups: NDArray[np.int64], sums: NDArray[np.float64], weights: NDArray[np.float64]
) -> dict[str, Any] | None:
    """Compute a weighted mean and its 95 % interval.

    Args:
        groups: group of each entry, (n,); the entries of a group are drawn together.
        sums: value times weight of each entry, (n,); NaN: the entry does not count.
        weights: weight of each entry, (n,).

    Returns:
        As `estimate`, and `p`, the two-sided p value of Student's t test of a mean of zero, over
        groups; None for a single group. None if no entry has a weight.
    """
    counted = np.isfinite(sums) & (weights > 0)
    if not counted.any():
        return None
    entries = np.stack([sums, weights])[:, counted]
    mean = estimate(groups[counted], entries, _ratio)
    if mean["groups"] < 2:
        return mean | {"p": None}
    error = standard_error([_sums(groups[counted], entries)], _ratio)
    return mean | {"p": p_value(mean["value"], error, mean["groups"])}


def p_value(value: float, error: float, groups: int) -> float:
    """Return the two-sided p value of Student's t test of a statistic that is zero by hypothesis.

    Args:
        value: value of the statistic.
        error: its standard error over groups.
        groups: number of groups, at least 2.
    """
    if error == 0.0:
        return float(value == 0.0)
    return float(2.0 * student.sf(abs(value) / error, groups - 1))


def holm(p_values: Sequence[float]) -> NDArray[np.float64]:
    """Return p values corrected for their number by Holm's method (1979), (n,).

    With a corrected p value below 0.05 as the criterion, the probability that any difference is
    called significant without being there is below 0.05, however the tests depend on each other.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p)
    corrected = np.empty_like(p)
    corrected[order] = np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p))))
    return np.minimum(corrected, 1.0)


def of_percentiles(estimated: dict[str, Any], groups: int) -> dict[str, Any]:
    """Return an estimate with an interval by Student's t in place of a bootstrap's percentiles.

    Results of earlier versions hold the 2.5th and the 97.5th percentile of resampled values, which
    lie too close together where there are few groups. Their distance gives the standard error.

    Args:
        estimated: `value`, `low` and `high`; both ends are None if there is no interval.
        groups: number of different groups that were resampled.

    Returns:
        The same with other ends, None below `MIN_GROUPS` groups, and with `p`, see `grouped_mean`.
    """
    low, high = estimated["low"], estimated["high"]
    if low is None or groups < 2:
        return estimated | {"low": None, "high": None, "p": None}
    value, tail = estimated["value"], 0.5 + CONFIDENCE / 2
    error = (high - low) / (2.0 * norm.ppf(tail)) * np.sqrt(groups / (groups - 1.0))
    half = student.ppf(tail, groups - 1) * error
    enough = groups >= MIN_GROUPS
    return estimated | {
        "low": float(value - half) if enough else None,
        "high": float(value + half) if enough else None,
        "p": p_value(value, float(error), groups),
    }


def _ratio(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    top, bottom = sums
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(top / bottom)


def _sums(
    groups: Sequence[Any] | NDArray[Any], entries: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sums of the entries (k, n) of each group, (k, groups)."""
    numbers: dict[Any, int] = {}
    number = np.array([numbers.setdefault(group, len(numbers)) for group in groups])
    return np.stack([np.bincount(number, entry) for entry in entries])
