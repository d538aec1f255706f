"""What the drives of the study say: the time of each driver against the best baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.runs import statistics
from benchmarks.runs.drive_series import paired_drives
from benchmarks.runs.statistics import BASELINES, ResultsByArm
from benchmarks.studies.worth.series import RULES, Series
from foresee.mapping.car_limits import CarLimits

Drives = Mapping[str, Sequence[dict[str, Any]]]
"""Name of each series → its drives."""


def rows(all_series: Sequence[Series], drives: Drives) -> list[dict[str, Any]]:
    """Return the measures of each driver on the tasks that all drivers of its group have driven."""
    groups: dict[tuple[Any, ...], list[Series]] = {}
    for series in all_series:
        groups.setdefault(series.group, []).append(series)
    return [row for group in groups.values() for row in _group_rows(group, drives)]


def _group_rows(group: Sequence[Series], drives: Drives) -> list[dict[str, Any]]:
    by_driver = paired_drives({series.driver: drives[series.name] for series in group})
    if not next(iter(by_driver.values())):
        return []
    return [_row(series, group, by_driver) for series in group]


def _row(series: Series, group: Sequence[Series], by_driver: ResultsByArm) -> dict[str, Any]:
    """Return the measures of a driver.

    Its time is compared with that of `known`, and with that of the best baseline: the driver
    without a network, at a risk of at most its own, that needs the least time where all of
    these reached the goal.
    """
    settings, results = series.settings, by_driver[series.driver]
    baselines = _baselines(series, group)
    together = statistics.reached(by_driver, tuple(baselines))
    times = {name: sum(result.time for result in of) for name, of in together.items() if of}
    best = min(times, key=times.__getitem__, default=None)
    compared = best is not None and series.driver not in baselines
    car = CarLimits(v_max=settings.v_max, braking=settings.braking)
    closed = None
    if compared and settings.route == "fixed" and series.driver != "oracle":
        closed = statistics.share_of_gap(by_driver, series.driver, "time", baselines)
    return {
        "part": series.part,
        "tasks": series.tasks,
        "driver": series.driver,
        "arm": series.arm,
        "predictor": settings.predictor,
        "window": settings.window,
        "v_max": settings.v_max,
        "stop_over_sight": car.stopping_distance / (0.5 * settings.window),
        "risk": settings.risk,
        "level": settings.level,
        "certified": settings.risk > 0 and not settings.uncertified,
        "earlier_calibration": any(r.earlier_calibration for r in results),
        "episodes": len(results),
        "reached": sum(r.outcome == "reached" for r in results),
        "collided": sum(r.outcome == "collided" for r in results),
        "learned": sum(r.learned for r in results),
        "hard_stops": sum(r.hard_stops or 0 for r in results),
        "promises_broken": statistics.promises_broken(results),
        "sct": statistics.success({series.driver: results}, series.driver),
        "time_ratio": statistics.time_ratio(by_driver, series.driver, "known"),
        "by_family": _by_family(series, by_driver),
        "baseline": best if compared else None,
        "time_over_baseline": (
            statistics.time_ratio(by_driver, series.driver, str(best)) if compared else None
        ),
        "gap_closed": closed,
        "commits": sorted({str(r.commit) for r in results}),
        # Number of the building → time to the goal [s], else how the drive ended.
        "drives": {r.index: r.time if r.outcome == "reached" else r.outcome for r in results},
    }


def _by_family(series: Series, by_driver: ResultsByArm) -> dict[str, dict[str, float | None]]:
    """Return the time ratio of a driver to `known` in each family of a mixture; {} for one kind.

    A family in which no building was driven to the goal by both is left out.
    """
    families = series.settings.families
    found = dict[str, dict[str, float | None]]()
    for family in families if len(families) > 1 else ():
        here = {
            driver: [r for r in by_driver[driver] if series.settings.family(r.index) == family]
            for driver in (series.driver, "known")
        }
        ratio = statistics.time_ratio(here, series.driver, "known")
        if ratio is not None:
            found[family] = ratio
    return found


def _baselines(series: Series, group: Sequence[Series]) -> list[str]:
    """Return the drivers of a group without a network, at a risk of at most that of a series."""
    rules = [
        other.driver
        for other in group
        if other.settings.predictor in RULES and other.settings.risk <= series.settings.risk
    ]
    driven = {other.driver for other in group}
    return [name for name in (*BASELINES, *rules) if name in driven]
