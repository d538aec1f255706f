"""Intervals and tests for paired episodes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, norm

from benchmarks.runs.drive_result import DriveResult
from foresee.statistics import CONFIDENCE, MIN_GROUPS, estimate

ResultsByArm = dict[str, list[DriveResult]]
"""Arm → its results on the paired episodes, in the same order for all arms."""

BASELINES = ("known", "backup")
"""Arms without a network, the better of which an arm with a network is compared with."""

BARN_CUT = (4.0, 8.0)
"""Multiples of T* to which the published score of the BARN challenge cuts times."""


def paired(results: Mapping[str, Iterable[DriveResult]]) -> ResultsByArm:
    """Return the results of arms, or of other drivers, on the episodes that all have finished.

    Args:
        results: name of each → its results, in any order.
    """
    by_index = {name: {r.index: r for r in of} for name, of in results.items()}
    common = sorted(set[int].intersection(*map(set, by_index.values())))
    return {name: [of[index] for index in common] for name, of in by_index.items()}


def wilson(successes: float, trials: float) -> tuple[float, float]:
    """Compute the 95 % Wilson interval of a share; the numbers need not be whole."""
    z2 = float(norm.ppf(0.5 + CONFIDENCE / 2)) ** 2 / trials
    share = successes / trials
    middle = (share + z2 / 2) / (1.0 + z2)
    half = math.sqrt(z2 * (share * (1.0 - share) + z2 / 4)) / (1.0 + z2)
    return max(0.0, middle - half), min(1.0, middle + half)


def rate_interval(happened: Sequence[bool], worlds: Sequence[str]) -> tuple[float, float] | None:
    """Compute the 95 % interval of the probability of an event in a drive, such as a collision.

    It is Wilson's interval for the number of independent drives, see `independent`. With one drive
    in each world, this is Wilson's interval of the drives. Unlike a bootstrap it holds if nothing
    happened.

    Args:
        happened: for each drive, whether the event happened.
        worlds: world of each drive.

    Returns:
        Both ends; None with fewer than `foresee.statistics.MIN_GROUPS` worlds.
    """
    if len(set(worlds)) < MIN_GROUPS:
        return None
    trials = independent(worlds)
    return wilson(trials * sum(happened) / len(happened), trials)


def independent(worlds: Sequence[str]) -> float:
    """Return the least number of independent drives that drives in these worlds count as.

    Drives in one map may all go alike. Then n drives in maps with m_1, m_2, … of them have a rate
    with the same variance as n² / (m_1² + m_2² + …) independent drives (Kish 1965): the number of
    maps, if each has as many drives. Whatever the drives in a map have in common, the variance is
    not larger.
    """
    return len(worlds) ** 2 / sum(count**2 for count in Counter(worlds).values())


def mean_speed(arms: ResultsByArm, arm: str, baseline: str | None = None) -> dict[str, Any]:
    """Compute the mean speed of an arm, total distance over total time [m/s], with its interval.

    Args:
        arms: results of each arm.
        arm: name of the arm.
        baseline: arm whose mean speed is subtracted; None: none.
    """
    names = (arm,) if baseline is None else (arm, baseline)
    entries = np.concatenate([_values(arms, key, *names) for key in ("path_length", "time")])

    def value(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        lengths, times = np.split(sums, 2)
        speeds = lengths / np.maximum(times, 1e-9)
        return np.asarray(speeds[0] if baseline is None else speeds[0] - speeds[1])

    return estimate(_worlds(arms), entries, value)


def success(arms: ResultsByArm, arm: str) -> dict[str, Any] | None:
    """Compute SCT, success weighted by completion time (Yokoyama, Ha and Batra 2021).

    It is the mean over episodes of T_bound / time; 0 for episodes in which the goal was not
    reached.

    Returns:
        As `estimate`. None if no episode has an SCT in all arms, as in older results.
    """
    scored = _scored(arms)
    return _mean(scored, _values(scored, "sct", arm)[0], (0.0, 1.0)) if scored[arm] else None


def barn_score(arms: ResultsByArm, arm: str, *, cut: bool) -> dict[str, Any] | None:
    """Compute the score of the BARN challenge (Xiao et al. 2022) of an arm.

    It is the mean over episodes of T* / time; 0 for episodes in which the goal was not reached.

    Args:
        arms: results of each arm.
        arm: name of the arm.
        cut: whether times are cut to 4 to 8 T*, as in the published scores.

    Returns:
        As `estimate`. None if no episode has a T* in all arms.
    """
    scored = _only(arms, lambda result: result.t_star is not None)
    if not scored[arm]:
        return None
    t_star, times = _values(scored, "t_star", arm)[0], _values(scored, "time", arm)[0]
    if cut:
        times = np.clip(times, *np.multiply.outer(BARN_CUT, t_star))
    reached = np.array([result.outcome == "reached" for result in scored[arm]])
    return _mean(scored, reached * t_star / times)


def time_ratio(arms: ResultsByArm, arm: str, baseline: str) -> dict[str, Any] | None:
    """Compute the total time of an arm divided by that of a baseline, where both reached the goal.

    Returns:
        As `estimate`, and `episodes`, the number of episodes that both reached. None if there are
        none.
    """
    both = reached(arms, (arm, baseline))
    if not both[arm]:
        return None
    times = _values(both, "time", arm, baseline)
    # Of the logarithm, so that the interval of the inverse ratio is the inverse.
    logs = estimate(_worlds(both), np.maximum(times, 1e-9), lambda sums: np.log(sums[0] / sums[1]))
    ratio = {k: None if logs[k] is None else math.exp(logs[k]) for k in ("value", "low", "high")}
    return ratio | {"groups": logs["groups"], "episodes": len(both[arm])}


def share_of_gap(
    arms: ResultsByArm, arm: str, key: str, baselines: Sequence[str] = BASELINES
) -> dict[str, Any] | None:
    """Compute the share of the gap between the best baseline and `oracle` that an arm closes.

    The share is (arm - baseline) / (oracle - baseline). The baseline is the best one over the same
    episodes.

    Args:
        arms: results of each arm.
        arm: arm with a network.
        key: "sct"; or "time", over the episodes that all of these arms reached. Time is for
            prescribed routes only, since on a free route a shorter route would count as faster
            driving.
        baselines: arms without a network, which take no more risk than the arm.

    Returns:
        As `estimate`, and `baseline`, the name of the best one. None if the interval of the
        denominator includes 0, there are fewer than `foresee.statistics.MIN_GROUPS` buildings, or
        arms or values are missing.
    """
    names = (*baselines, arm, "oracle")
    if not arms.keys() >= set(names):
        return None
    kept = _scored(arms) if key == "sct" else reached(arms, names)
    if not kept[arm]:
        return None
    totals = dict(zip(baselines, _values(kept, key, *baselines).sum(axis=1), strict=True))
    baseline = (max if key == "sct" else min)(totals, key=totals.__getitem__)
    values = _values(kept, key, baseline, arm, "oracle")
    lead = values[2] - values[0] if key == "sct" else values[0] - values[2]
    low = _mean(kept, lead)["low"]
    if low is None or low <= 0:
        return None

    def share(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        base, reached_by_arm, best = sums
        return np.asarray((reached_by_arm - base) / np.where(best == base, np.nan, best - base))

    return estimate(_worlds(kept), values, share) | {"baseline": baseline}


def _values(arms: ResultsByArm, key: str, *names: str) -> NDArray[np.float64]:
    """Return a field of the results of some arms, (arms, episodes)."""
    return np.array([[getattr(r, key) for r in arms[name]] for name in names], dtype=np.float64)


def _mean(
    arms: ResultsByArm,
    values: NDArray[np.float64],
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> dict[str, Any]:
    """Compute the mean of values over the episodes of some arms, (episodes,)."""
    entries = np.stack([values, np.ones(len(values))])
    return estimate(_worlds(arms), entries, lambda sums: sums[0] / sums[1], bounds)


def _scored(arms: ResultsByArm) -> ResultsByArm:
    """Return only the episodes that have an SCT in every arm."""
    return _only(arms, lambda result: result.sct is not None)


def reached(arms: ResultsByArm, names: tuple[str, ...]) -> ResultsByArm:
    """Return the results of some arms on the episodes in which all of these reached the goal."""
    chosen = {name: arms[name] for name in names}
    return _only(chosen, lambda result: result.outcome == "reached")


def _only(arms: ResultsByArm, wanted: Callable[[DriveResult], bool]) -> ResultsByArm:
    keep = [all(map(wanted, results)) for results in zip(*arms.values(), strict=True)]
    return {name: list(compress(results, keep)) for name, results in arms.items()}


def _worlds(arms: ResultsByArm) -> list[str]:
    return [result.world for result in next(iter(arms.values()))]


def mcnemar(first: list[DriveResult], second: list[DriveResult], outcome: str) -> float:
    """Compute the two-sided p value of the exact McNemar test on an outcome of two arms.

    Several drives in one world count as one, in favour of the arm with fewer such outcomes.

    Args:
        first: results of one arm.
        second: results of the other arm on the same episodes.
        outcome: outcome whose frequency is compared, such as "collided".
    """
    more = Counter[str]()
    for x, y in zip(first, second, strict=True):
        more[x.world] += (x.outcome == outcome) - (y.outcome == outcome)
    a, b = (sum(sign * count > 0 for count in more.values()) for sign in (1, -1))
    return float(binomtest(a, a + b).pvalue) if a + b else 1.0


def promises_broken(results: Sequence[DriveResult]) -> dict[str, Any] | None:
    """Compute the share of broken promises, averaged over buildings; None without promises."""
    made, broken = Counter[str](), Counter[str]()
    for r in results:
        if r.promises:
            made[r.world] += r.promises
            broken[r.world] += r.promises_broken
    if not made:
        return None
    shares = np.array([[broken[world] / made[world] for world in made]])
    entries = np.concatenate([shares, np.ones_like(shares)])
    return estimate(list(made), entries, lambda sums: sums[0] / sums[1], (0.0, 1.0))
