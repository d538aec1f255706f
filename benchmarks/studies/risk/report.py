"""What the drives of the study say: collisions at each risk, and speed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import chi2

from benchmarks.runs import statistics
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.drive_result import DriveResult
from benchmarks.runs.drive_series import paired_drives, predictor_label
from benchmarks.runs.statistics import ResultsByArm
from benchmarks.studies.risk.drives import Drives
from benchmarks.studies.risk.series import MIXTURE, OWN, PROMISE, Series
from foresee.statistics import MIN_GROUPS
from planner.revision import FIRST

BASELINES = ("known", "oracle", "full")


def collision_rows(
    all_series: Sequence[Series], drives: Drives, certified: Container[float]
) -> list[dict[str, Any]]:
    """Return the requested and the realised risk of each series that has a drive.

    Args:
        all_series: series of the study.
        drives: name of each series → its drives.
        certified: risks that the calibration has certified.
    """
    rows = []
    for series in all_series:
        driven = _with_task(drives[series.name])
        if not driven:
            continue
        outcomes, worlds = Counter(d["outcome"] for d in driven), [d["world"] for d in driven]
        collided, km = outcomes["collided"], sum(d["path_length"] for d in driven) / 1e3
        rows.append(
            _about(series)
            | {
                "requested": series.risk,
                "certified": series.risk in certified,
                "earlier_calibration": _is_of_earlier_planner(series, driven),
                "drives": len(driven),
                "worlds": len(set(worlds)),
                "no_task": len(drives[series.name]) - len(driven),
                "collided": collided,
                "rate": collided / len(driven),
                "interval": statistics.rate_interval(_collided(driven), worlds),
                "touched": sum(d["touched"] for d in driven),
                "learned": sum(d["learned"] for d in driven),
                "km": km,
                "per_km_interval": _per_km(collided, km, worlds),
                "outcomes": dict(outcomes),
                "by_family": _by_family(series, driven),
                "sct": _mean([d["sct"] for d in driven]),
                "speed": 1e3 * km / sum(d["time"] for d in driven),
                "impact_speed": _mean([d["impact_speed"] for d in driven]),
                "commits": sorted({str(d["commit"]) for d in driven}),
            }
        )
    return rows


def _is_of_earlier_planner(series: Series, driven: Sequence[dict[str, Any]]) -> bool:
    """Return whether the level was calibrated with an earlier revision of the driving."""
    settings = series.settings
    return settings.level > 0.0 and any(
        d.get("revision", FIRST) > settings.calibrated for d in driven
    )


def exceeds_its_risk(row: dict[str, Any]) -> bool:
    """Return whether a row of `collision_rows` shows more collisions than were accepted.

    At a risk of 0 no car may collide. A certified risk is for the buildings of the calibration.
    """
    if row["requested"] == 0.0:
        return bool(row["collided"] or row["touched"])
    in_mixture = row["certified"] and (row["group"], row["tasks"]) == (PROMISE, MIXTURE)
    # Further calibrations are driven only at the risks that they certify.
    certified = in_mixture or row["group"] == OWN
    return bool(certified and row["interval"] and row["interval"][0] > row["requested"])


def speed_rows(all_series: Sequence[Series], drives: Drives) -> list[dict[str, Any]]:
    """Return SCT and times of each series, among the series with its tasks."""
    rows = []
    for series in all_series:
        same_tasks = _baselines(series, all_series, drives)
        if not same_tasks:
            continue
        # The statistics call the arm that is compared `predicted`.
        baselines = {arm: of for arm, of in same_tasks.items() if arm != series.arm}
        arms = paired_drives({"predicted": drives[series.name], **baselines})
        if not arms["predicted"]:
            continue
        known, full = (
            statistics.time_ratio(arms, "predicted", arm) if arm in baselines else None
            for arm in ("known", "full")
        )
        rows.append(
            _about(series)
            | {
                "episodes": len(arms["predicted"]),
                "collided": sum(r.outcome == "collided" for r in arms["predicted"]),
                "sct": statistics.success(arms, "predicted"),
                "time_ratio": known,
                "time_over_full": full,
                "time_by_family": _times_by_family(series, arms),
            }
        )
    return rows


def pooled_rows(all_series: Sequence[Series], drives: Drives) -> list[dict[str, Any]]:
    """Return collisions and times at each risk, over the buildings of all further calibrations.

    Each calibration gives a level of its own for the risk.

    Args:
        all_series: series of the study.
        drives: name of each series → its drives.
    """
    further = [s for s in all_series if s.group == OWN and s.arm == "predicted"]
    rows = []
    for risk in sorted({s.risk for s in further if s.risk is not None}):
        levels, drives_at = dict[str, float](), list[dict[str, Any]]()
        arms: dict[str, list[DriveResult]] = {arm: [] for arm in ("predicted", "known", "oracle")}
        for series in (s for s in further if s.risk == risk):
            levels[series.tasks] = series.settings.level
            drives_at += _with_task(drives[series.name])
            baselines = _baselines(series, all_series, drives)
            for arm, results in paired_drives(
                {"predicted": drives[series.name], **baselines}
            ).items():
                arms[arm] += results
        if drives_at:
            collided, worlds = _collided(drives_at), [d["world"] for d in drives_at]
            rows.append(
                {
                    "requested": risk,
                    "levels": levels,
                    "drives": len(drives_at),
                    "worlds": len(set(worlds)),
                    "collided": sum(collided),
                    "interval": statistics.rate_interval(collided, worlds),
                    "time_ratio": statistics.time_ratio(arms, "predicted", "known"),
                }
            )
    return rows


def _baselines(series: Series, all_series: Sequence[Series], drives: Drives) -> Drives:
    """Return the drives of each baseline, by arm, in the tasks of a series."""
    same = [s for s in all_series if (s.group, s.tasks) == (series.group, series.tasks)]
    return {s.arm: drives[s.name] for s in same if s.arm in BASELINES}


def _about(series: Series) -> dict[str, Any]:
    """Return what a row of results says about its series."""
    same = ("route", "vehicle", "v_max", "braking", "window", "level", "seed")
    return {
        "group": series.group,
        "series": series.label,
        "tasks": series.tasks,
        "arm": series.arm,
        "world": [Path(place).stem for place in series.settings.world],
        "predictor": predictor_label(series.settings.predictor),
        "adapted": not series.settings.fixed_level,
        **{name: getattr(series.settings, name) for name in same},
    }


def _by_family(series: Series, drives: Sequence[dict[str, Any]]) -> dict[str, list[int]]:
    """Return the collisions and the drives in each family of a mixture."""
    return {
        family: [sum(d["outcome"] == "collided" for d in there), len(there)]
        for family in series.settings.families
        if (there := [d for d in drives if series.settings.family(d["index"]) == family])
    }


def _times_by_family(series: Series, arms: ResultsByArm) -> dict[str, dict[str, Any]]:
    """Return the time ratio to `known` in each family."""
    times = {}
    for family in series.settings.families:
        here = {
            arm: [r for r in results if series.settings.family(r.index) == family]
            for arm, results in arms.items()
        }
        if "known" in here and here["known"] and series.settings.route == "fixed":
            times[family] = {"time_ratio": statistics.time_ratio(here, "predicted", "known")}
    return times


def _with_task(drives: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [drive for drive in drives if drive["outcome"] != NO_TASK]


def _collided(drives: Sequence[dict[str, Any]]) -> list[bool]:
    return [drive["outcome"] == "collided" for drive in drives]


def _per_km(count: int, km: float, worlds: Sequence[str]) -> tuple[float, float] | None:
    """Return the exact 95 % interval of a rate [1/km], for as many independent drives.

    None if nothing was driven, or in fewer than `MIN_GROUPS` worlds.
    """
    if km == 0.0 or len(set(worlds)) < MIN_GROUPS:
        return None
    share = statistics.independent(worlds) / len(worlds)
    low = chi2.ppf(0.025, 2 * count * share) / 2 if count else 0.0
    high = chi2.ppf(0.975, 2 * count * share + 2) / 2
    return float(low / (km * share)), float(high / (km * share))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
