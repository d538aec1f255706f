"""The file of time-optimal drives that `benchmarks.optimum` writes, and its reading."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.optimal.search import time_optimal
from benchmarks.optimal.shortest_path import time_bound
from benchmarks.runs.car import limits_for
from benchmarks.runs.drive_file import read_drives
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task, shortest_length, task_facts
from foresee.infra.command_line import UsageError
from foresee.infra.environment import commit
from foresee.infra.markdown import DASH, records
from foresee.infra.plain_json import fits
from sim.episode import EpisodeConfig
from sim.task import NoTaskError

Key = tuple[str, int, tuple[float, ...], tuple[float, ...]]
"""Identity of a task: building, seed, start (x, y, yaw) and goal (x, y), rounded."""
KIND = "optimum"
TASK_AND_TIME = {
    "index": int,
    "world": str,
    "seed": int,
    "start": list[float],
    "goal": list[float],
    "t_opt": float | None,
}
"""Facts of each drive that a comparison needs, and their types."""
ENTRY = TASK_AND_TIME | {"t_bound": float | None, "shortest": float | None}
"""Facts of each drive in the file, and their types."""


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


def attempt(settings: Settings, index: int) -> dict[str, Any] | str:
    """Return an episode's entry in the results file, or one line that says why it has no task."""
    started = time.perf_counter()
    car = limits_for(settings)
    radius = EpisodeConfig().goal_radius
    try:
        task = make_task(settings, index)
    except NoTaskError as error:
        return str(error)
    length = shortest_length(task, car.body.half_width)
    # None if no path was found; a drive may still exist, through a gap hardly wider than the car.
    shortest = None if length is None else round(length, 4)
    drive, tried = time_optimal(task, car, radius)
    result = {
        "index": index,
        **task_facts(task),
        "t_opt": None,
        "t_bound": None if shortest is None else round(time_bound(shortest, car, radius), 4),
        "shortest": shortest,
        "guesses": tried,
        "commit": commit(),
    }
    if drive is not None:
        stride = 2 if len(drive.controls) % 2 == 0 else 1
        result |= {
            "t_opt": round(drive.time, 4),
            "guess": drive.name,
            "status": drive.status,
            "dt": round(drive.dt, 6),
            "every": stride,
            "states": [[round(float(v), 3) for v in state] for state in drive.states[::stride]],
        }
    return result | {"wall": round(time.perf_counter() - started, 2)}


def read_t_opt(
    path: Path, settings: Settings | None = None, maps: Mapping[str, str] | None = None
) -> dict[Key, float | None]:
    """Read the least time T_opt of each task [s]; None for a task without a drive.

    Args:
        path: file that `benchmarks.optimum` has written.
        settings: settings of the run, which must have the same car; None: not checked.
        maps: hash of each map file of the run, which must be the same in the file, if it names
            them; None: not checked.

    Raises:
        UsageError: if the file cannot be read, or is something else, of another car, or of a map
            that has been edited since.
    """
    content = read_drives(path, KIND, TASK_AND_TIME)
    recorded = content["settings"]
    for name in ("v_max", "braking"):
        value = recorded.get(name)
        if not fits(value, float):
            raise UsageError(f"{path} is no file of benchmarks.optimum: it has no {name}")
        if settings is not None and value != getattr(settings, name):
            raise UsageError(f"{path} is of {name} {value:g}, not {getattr(settings, name):g}")
    hashes = recorded.get("maps")
    if maps and isinstance(hashes, dict):
        edited = [place for place in maps if hashes.get(place, maps[place]) != maps[place]]
        if edited:
            raise UsageError(f"{path} is of another version of {', '.join(edited)}")
    drives = content["drives"]
    return {task_key(d["world"], d["seed"], d["start"], d["goal"]): d["t_opt"] for d in drives}


def table(content: dict[str, Any]) -> str:
    """Return a Markdown table of the means over drives whose T_opt and T_bound are known."""
    drives = content["drives"]
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
