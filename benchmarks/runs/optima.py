"""Reading of the time-optimal drives that `benchmarks.optimum` has written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.settings import Settings
from foresee.infra.command_line import UsageError
from foresee.infra.markdown import DASH, records

Key = tuple[str, int, tuple[float, ...], tuple[float, ...]]
"""Identity of a task: building, seed, start (x, y, yaw) and goal (x, y), rounded."""
KIND = "optimum"


def task_key(world: str, seed: int, start: Sequence[float], goal: Sequence[float]) -> Key:
    """Return the identity of a task, with coordinates rounded to 1 mm and 1 mrad.

    Args:
        world: name of the building.
        seed: seed of the task.
        start: x, y, yaw of the start [m, m, rad].
        goal: x, y of the goal [m].
    """
    return world, int(seed), _rounded(start), _rounded(goal)


def _rounded(numbers: Sequence[float]) -> tuple[float, ...]:
    # Adding 0 turns −0 into 0.
    return tuple(round(float(number), 3) + 0.0 for number in numbers)


def optimum_of(path: Path, settings: Settings | None = None) -> dict[Key, float | None]:
    """Read the least time T_opt of each task [s]; None for a task without a drive.

    Args:
        path: file that `benchmarks.optimum` has written.
        settings: settings of the run, which must have the same car; None: not checked.

    Raises:
        UsageError: if the file cannot be read, or is of another car.
    """
    found = read_optima(path)
    for name in ("v_max", "braking") if settings is not None else ():
        theirs, mine = found["settings"][name], getattr(settings, name)
        if mine != theirs:
            raise UsageError(f"{path} is of {name} {theirs:g}, not {mine:g}")
    return {
        task_key(d["world"], d["seed"], d["start"], d["goal"]): d["t_opt"] for d in found["drives"]
    }


def read_optima(path: Path) -> dict[str, Any]:
    """Read a file of optima.

    Raises:
        UsageError: if it cannot be read, or is something else.
    """
    found = read_drives(path, KIND)
    try:
        # These raise if a value that others use is missing or of a wrong type.
        [(d["t_opt"], d["t_bound"], *_rounded(d["start"])) for d in found["drives"]]
        [float(found["settings"][name]) for name in ("v_max", "braking")]
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{path} is no file of benchmarks.optimum") from None
    return found


def table(found: dict[str, Any]) -> str:
    """Return a Markdown table of the means over drives whose T_opt and T_bound are known."""
    drives = found["drives"]
    known = [d for d in drives if d["t_opt"] is not None and d["t_bound"] is not None]
    row: dict[str, Any] = {"tasks": len(drives), "drives found": len(known)}
    columns = (
        ("t_opt", "T_opt [s]", ".2f"),
        ("t_bound", "T_bound [s]", ".2f"),
        ("shortest", "shortest path [m]", ".1f"),
    )
    for name, head, form in columns:
        row[head] = f"{sum(d[name] for d in known) / len(known):{form}}" if known else DASH
    return records([row])
