"""The tables of the study of errors, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.statistics import wilson
from benchmarks.studies.robustness.error_drives import COSTS, FACTORS, TOLD, cases_of
from foresee.infra.markdown import figure, interval, records
from foresee.mapping.conventions import NOISE_CUT, TICK
from foresee.statistics import grouped_mean

Drives = list[dict[str, Any]]
TITLES = {
    "delay": "delay {:g} s",
    "jitter": "jitter {:g} s",
    "lag": "lag {:g} s",
    "pose_error": "position {:g} m",
    "yaw_error": "yaw {:g} rad",
    "noise": "ranges {:g} m",
    "dropout": "{:.0%} of the beams missing",
    "missed": "{:.0%} of the ticks missed",
}
"""Setting of an error → its name in tables, with its value."""


def tables(results: dict[str, Any]) -> str:
    """Return the table of a results file of `foresee errors`."""
    return table(results["settings"]["part"], results["drives"])


def table(part: str, drives: Drives) -> str:
    """Return the table of a part of the study.

    Args:
        part: part of the study.
        drives: its drives.
    """
    rows: dict[str, Callable[[Drives], Iterator[dict[str, Any]]]]
    rows = {"beyond": _beyond, "cost": _cost, "late": _late, "people": _people}
    return records(list(rows[part]([d for d in drives if d["outcome"] != NO_TASK])))


def _of(drives: Drives, case: Mapping[str, Any]) -> Drives:
    return [d for d in drives if all(d[name] == value for name, value in case.items())]


def _named(setting: str, value: float) -> str:
    """Return an error with its value; of ranges, which have a standard deviation, the bound."""
    return TITLES[setting].format(value * (NOISE_CUT if setting == "noise" else 1.0))


def _beyond(drives: Drives) -> Iterator[dict[str, Any]]:
    """Yield a row for each error that is told, with the contacts at each multiple of it."""
    for setting, told in TOLD.items():
        cells = {}
        for factor in FACTORS:
            them = _of(drives, {"setting": setting, "factor": factor})
            met = [d for d in them if d.get("touched") or d["outcome"] in ("collided", "crashed")]
            cells[f"× {factor:g}"] = f"{len(met)} of {len(them)}"
        yield {"told": _named(setting, told), **cells}


def _cost(drives: Drives) -> Iterator[dict[str, Any]]:
    """Yield a row for each case, compared with the same tasks without errors."""
    for case in cases_of("cost"):
        them = _of(drives, case)
        if drives and not them:
            # Older files hold fewer errors.
            continue
        ((error, value),) = case["error"].items()
        names = {"error": _named(error, value) if value else "none"}
        yield _timed(drives, case, names, case | {"error": COSTS[0]})


def _late(drives: Drives) -> Iterator[dict[str, Any]]:
    """Yield a row for each case, compared with `known` in the same tasks."""
    for case in cases_of("late"):
        late = "" if case["arm"] == "known" else f"{case['ticks'] * TICK:g}"
        first = {"family": case["family"], "arm": "known"}
        yield _timed(drives, case, {"predictions late by [s]": late}, first)


def _timed(
    drives: Drives, case: dict[str, Any], names: dict[str, str], first: dict[str, Any]
) -> dict[str, Any]:
    """Return the row of a case of drives to a goal, with the time ratio to another case.

    Args:
        drives: drives of all cases.
        case: the case.
        names: cells of the row that tell the case from others of the same family and arm.
        first: the case that it is compared with, in the buildings in which both reach the goal.
    """
    them, goal = _of(drives, case), {"outcome": "reached"}
    compared = {d["building"]: d for d in _of(drives, first | goal)}
    both = [d for d in _of(them, goal) if d["building"] in compared]
    ratio = grouped_mean(
        np.array([d["building"] for d in both], dtype=np.int64),
        np.array([d["time"] for d in both], dtype=np.float64),
        np.array([compared[d["building"]]["time"] for d in both], dtype=np.float64),
    )
    return {
        "family": case["family"],
        "arm": f"`{case['arm']}`",
        **names,
        "drives": len(them),
        "reached": len(_of(them, goal)),
        "collided": len(_of(them, {"outcome": "collided"})),
        "time ratio": "1" if first.items() <= case.items() else interval(ratio, ".2f"),
    }


def _people(drives: Drives) -> Iterator[dict[str, Any]]:
    """Yield a row for each case: contacts with people, and how fast the car was then."""
    for case in cases_of("people"):
        them = _of(drives, case)
        touches = [d["touch"] for d in them if d["touch"]]
        moving = [t["speed"] for t in touches if not t["rest"]]
        hours, count = sum(d["seconds"] for d in them) / 3600.0, max(1, len(them))
        ends = wilson(len(touches), count)
        yield {
            "top speed [m/s]": f"{case['v_max']:g}",
            "people": f"keep {case['apart']:g} m away" if case["apart"] else "do not look",
            "drives": len(them),
            "touched a person": figure(len(touches) / count, ends, ".0f", 100.0, " %"),
            "of these at rest": len(touches) - len(moving),
            "moving, per hour": f"{len(moving) / hours:.0f}" if hours else "",
            "speed of the moving car [m/s]": (
                f"{np.median(moving):.1f}, at most {max(moving):.1f}" if moving else ""
            ),
            "hours": f"{hours:.2f}",
        }
