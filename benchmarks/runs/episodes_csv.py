"""The file episodes.csv: one row for each drive of a run, for spreadsheets and data frames."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.runs.drive_result import DriveResult
from foresee.infra.atomic_file import write_whole

EPISODES = "episodes.csv"
"""Name of the file."""
COLUMNS: dict[str, Callable[[DriveResult], Any]] = {
    "episode": lambda r: r.index,
    "building": lambda r: r.world,
    "seed": lambda r: r.seed,
    "arm": lambda r: r.arm,
    "vehicle": lambda r: r.vehicle,
    "outcome": lambda r: r.outcome,
    "time_s": lambda r: r.time,
    "driven_m": lambda r: r.path_length,
    "shortest_path_m": lambda r: r.shortest_length,
    "prescribed_route_m": lambda r: r.shortest,
    "t_bound_s": lambda r: r.t_bound,
    "t_opt_s": lambda r: r.t_opt,
    "sct": lambda r: r.sct,
    "detour_factor": lambda r: r.detour,
    "mean_speed_m_per_s": lambda r: r.mean_speed,
    "top_speed_m_per_s": lambda r: r.max_speed,
    "impact_speed_m_per_s": lambda r: r.impact_speed,
    "least_clearance_m": lambda r: r.min_clearance,
    "stops": lambda r: r.stops,
    "hard_stops": lambda r: r.hard_stops,
    "ticks": lambda r: r.ticks,
    "promises": lambda r: r.promises,
    "promises_broken": lambda r: r.promises_broken,
    "handled_faults": lambda r: sum(r.faults.values()),
    "late_controls": lambda r: r.late_ticks,
    "late_predictions": lambda r: r.late_predictions,
    "cycle_median_ms": lambda r: r.cycle_ms[0],
    "cycle_99th_percentile_ms": lambda r: r.cycle_ms[1],
    "level": lambda r: r.level,
    "trained_on_building": lambda r: r.learned,
    "start_x_m": lambda r: r.start[0],
    "start_y_m": lambda r: r.start[1],
    "start_yaw_rad": lambda r: r.start[2],
    "goal_x_m": lambda r: r.goal[0],
    "goal_y_m": lambda r: r.goal[1],
    "commit": lambda r: r.commit,
}
"""Column → function from a drive to its value; None is an empty cell."""


def write_episodes(results: Sequence[DriveResult], folder: Path) -> Path:
    """Write episodes.csv of some drives into a folder, and return its path."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows([value(result) for value in COLUMNS.values()] for result in results)
    path = folder / EPISODES
    # Half a surrogate pair, which the name of a map may hold, is written as \ud800.
    write_whole(path, text.getvalue().encode(errors="backslashreplace"))
    return path
