"""Results of drives that nobody drove."""

from benchmarks.runs.drive_result import DriveResult
from planner.revision import revision_of


def a_result(route="free", **changes) -> DriveResult:
    """The result of a drive of today that reached its goal, but for what is changed."""
    plain = {
        "arm": "known",
        "index": 0,
        "world": "w",
        "seed": 0,
        "start": [1.0, 2.0, 0.0],
        "goal": [9.0, 2.0],
        "learned": False,
        "shortest": 8.0,
        "outcome": "reached",
        "time": 10.0,
        "path_length": 20.0,
        "mean_speed": 2.0,
        "max_speed": 3.0,
        "min_clearance": 0.5,
        "stops": 0,
        "impact_speed": None,
        "promises": 1,
        "promises_broken": 0,
        "ticks": 100,
        "faults": {},
        "paths": {},
        "commit": None,
        "cycle_ms": [1.0, 2.0],
        "revision": revision_of(route),
    }
    return DriveResult(**plain | changes)
