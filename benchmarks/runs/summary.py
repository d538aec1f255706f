"""The summary of a comparison: the measures of each arm over all paired episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.runs import statistics
from benchmarks.runs.arms import CALIBRATED_ARM, arm_kind
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.statistics import ResultsByArm
from sim.episode import Outcome

OUTCOMES = tuple(map(str, Outcome))


def _paired(episodes: list[DriveResult], arms: tuple[str, ...]) -> ResultsByArm:
    """Return the results of each arm on the episodes that all arms have finished."""
    return statistics.paired({arm: [r for r in episodes if r.arm == arm] for arm in arms})


def summarise(episodes: list[DriveResult], arms: tuple[str, ...]) -> dict[str, Any]:
    """Return arm → measures over the paired episodes; {} if no episode is finished by all arms."""
    by_arm = _paired(episodes, arms)
    if not next(iter(by_arm.values()), []):
        return {}
    return {arm: _measures(by_arm, arm) for arm in arms}


def _measures(by_arm: ResultsByArm, arm: str) -> dict[str, Any]:
    """Compute the measures of an arm over the paired episodes; None for one that is not known."""
    results = by_arm[arm]
    reached = [r for r in results if r.outcome == "reached"]
    together = statistics.reached(by_arm, tuple(by_arm))[arm]
    faults, paths = Counter[str](), Counter[str]()
    for r in results:
        faults.update(r.faults)
        paths.update(r.paths)
    counts = {name: sum(r.outcome == name for r in results) for name in OUTCOMES}
    collided = [r.outcome == "collided" for r in results]
    compared = arm != "known" and "known" in by_arm
    ratio = {"time_ratio": statistics.time_ratio(by_arm, arm, "known")} if compared else {}
    entry: dict[str, Any] = {
        "vehicle": results[0].vehicle,
        "earlier_calibration": any(r.earlier_calibration for r in results),
        "uncertified": any(r.uncertified for r in results),
        "level": results[0].level,
        **_with_ends("sct", statistics.success(by_arm, arm)),
        **_with_ends("barn_score", statistics.barn_score(by_arm, arm, cut=True)),
        **_with_ends("barn_score_uncut", statistics.barn_score(by_arm, arm, cut=False)),
        "over_optimum": _ratio(reached, "time", "t_opt"),
        "detour": _ratio(reached, "path_length", "shortest_length"),
        "t_bound": _mean(r.t_bound for r in results),
        "t_opt": _mean(r.t_opt for r in results),
        **ratio,
        "episodes": len(results),
        **counts,
        "collided_interval": statistics.rate_interval(collided, [r.world for r in results]),
        **_with_ends("mean_speed", statistics.mean_speed(by_arm, arm)),
        "time_to_goal": _mean(r.time for r in together),
        "time_to_goal_episodes": len(together),
        "max_speed": max(r.max_speed for r in results),
        "min_clearance": min(r.min_clearance for r in results),
        "stops": sum(r.stops for r in results),
        "hard_stops": _sum(r.hard_stops for r in results),
        "impact_speed": _mean(r.impact_speed for r in results),
        "cycle_ms_p50": float(np.median([r.cycle_ms[0] for r in results])),
        "cycle_ms_p99": float(np.median([r.cycle_ms[1] for r in results])),
        "late_ticks": _sum(r.late_ticks for r in results),
        "late_predictions": _sum(r.late_predictions for r in results),
        "ticks": sum(r.ticks for r in results),
        "faults": faults,
        "paths": paths,
        **_with_ends("promises_broken", statistics.promises_broken(results)),
    }
    if compared:
        entry["faster_than_known"] = statistics.mean_speed(by_arm, arm, "known")
        entry["collided_p"] = statistics.mcnemar(results, by_arm["known"], "collided")
    return entry


def _with_ends(name: str, estimated: dict[str, Any] | None) -> dict[str, Any]:
    """Return the value and the interval of an estimate, as NAME and NAME_interval."""
    if estimated is None:
        return {name: None, f"{name}_interval": None}
    ends = [estimated["low"], estimated["high"]]
    return {name: estimated["value"], f"{name}_interval": None if None in ends else ends}


def _ratio(results: list[DriveResult], top: str, bottom: str) -> float | None:
    """Return the sum of one field over the sum of another, for results in which both are known."""
    known = [r for r in results if getattr(r, bottom) is not None]
    sums = [sum(getattr(r, key) for r in known) for key in (top, bottom)]
    return sums[0] / sums[1] if known else None


def _sum(values: Iterable[int | None]) -> int | None:
    """Return the sum of the values; None if one is not known."""
    known = list(values)
    return None if None in known else sum(filter(None, known))


def _mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the values that are not None; None if all are."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def gap(episodes: list[DriveResult], arms: tuple[str, ...], route: str) -> dict[str, Any]:
    """Return the share of the gap between the best baseline and `oracle` that a network closes.

    Returns:
        For each arm that may take a risk: `sct`, the share in SCT, and `time`, the share in time,
        on a prescribed route only. Each is None if `statistics.share_of_gap` gives none, and if
        the arm takes a risk: the baseline would have to take the same, and no arm without a
        network does. `benchmarks.studies.worth` compares with rules that do.
    """
    by_arm = _paired(episodes, arms)

    def share(arm: str, key: str) -> dict[str, Any] | None:
        at_a_risk = arm != CALIBRATED_ARM or any(result.level for result in by_arm[arm])
        return None if at_a_risk else statistics.share_of_gap(by_arm, arm, key)

    return {
        arm: {"sct": share(arm, "sct"), "time": share(arm, "time") if route == "fixed" else None}
        for arm in arms
        if arm_kind(arm) == CALIBRATED_ARM
    }
