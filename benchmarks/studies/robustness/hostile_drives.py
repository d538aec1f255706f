"""Drives with hostile predictors, in all families of buildings."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.runs.drive import limits_for, navigator_for
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.settings import ARMS, VEHICLES, Settings
from benchmarks.runs.tasks import make_task
from benchmarks.studies.robustness.hostile_predictors import DEADLINE, KINDS, Hostile
from foresee.infra.environment import commit
from foresee.infra.markdown import DASH, records
from foresee.mapping.family_names import FAMILIES
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import EpisodeConfig, run_episode
from sim.task import NoTaskError

RELIANCES = (0.0, 0.05, 0.2, 0.5, 0.99)
SPEEDS = (2.0, 4.0, 6.0)


def scenario(index: int, seed: int) -> tuple[str, Settings]:
    """Return the hostile predictor and the settings of a drive."""
    rng = np.random.default_rng([seed, index])
    # Kinds and families take turns, so that each pair comes once before any is repeated; all other
    # settings are drawn at random.
    kind = list(KINDS)[index % len(KINDS)]
    family = FAMILIES[(index // len(KINDS) + index) % len(FAMILIES)]
    settings = Settings(
        world=(family,),
        route=str(rng.choice(("free", "fixed"))),
        episodes=1,
        seed=seed + index,
        arms=("predicted",),
        predictor="none",
        reliance=float(rng.choice(RELIANCES)),
        v_max=float(rng.choice(SPEEDS)),
        vehicle=str(rng.choice(tuple(VEHICLES))),
    )
    return kind, settings


def attacked(seed: int, seconds: float, index: int) -> dict[str, Any]:
    """Drive once with a hostile predictor, and return the entry of the drive in the results.

    An exception that reaches this function is recorded as `error`.

    Args:
        seed: seed of the first building.
        seconds: longest duration of the drive in simulated time [s].
        index: number of the drive.
    """
    kind, settings = scenario(index, seed)
    entry: dict[str, Any] = {
        "index": index,
        "kind": kind,
        "world": settings.world[0],
        **{k: getattr(settings, k) for k in ("seed", "route", "vehicle", "reliance", "v_max")},
        "commit": commit(),
    }
    try:
        task = make_task(settings, 0)
    except NoTaskError as error:
        return entry | {"outcome": NO_TASK, "error": None, "note": str(error)}
    driver = navigator_for(settings, ARMS["predicted"], task, Hostile(KINDS[kind]), DEADLINE)
    car, lidar = DubinsCar(limits_for(settings)), Lidar(LidarConfig())
    config = EpisodeConfig(timeout=seconds * settings.v_max / task.path_length)
    rng = np.random.default_rng([task.seed, 2])
    try:
        episode = run_episode(task, driver, car, lidar, config, rng)
    except Exception as error:
        # The program must survive every hostile predictor: an exception here is a failure.
        return entry | {"outcome": "crashed", "error": f"{type(error).__name__}: {error}"}
    return entry | {
        "outcome": str(episode.outcome),
        "error": None,
        "time": round(episode.time, 1),
        "path_length": round(episode.path_length, 2),
        "max_speed": round(episode.max_speed, 2),
        "impact_speed": episode.impact_speed,
        "ticks": len(episode.trace["kept"]),
        "faults": episode.faults,
    }


def table(results: dict[str, Any]) -> str:
    """Return a Markdown table of drives, collisions and faults for each hostile predictor."""
    rows = []
    drives = [d for d in results["drives"] if d["outcome"] != NO_TASK]
    for name in (*KINDS, "all"):
        of_kind = [d for d in drives if name in ("all", d["kind"])]
        if not of_kind:
            continue
        whole = [d for d in of_kind if d["outcome"] != "crashed"]
        seconds = sum(d["time"] for d in whole)
        metres = sum(d["path_length"] for d in whole)
        rows.append(
            {
                "predictor": name,
                "drives": len(of_kind),
                "collided": sum(d["outcome"] == "collided" for d in of_kind),
                "program errors": len(of_kind) - len(whole),
                "mean speed [m/s]": f"{metres / seconds:.2f}" if seconds else DASH,
                "faults per drive": f"{sum(map(_faults, whole)) / max(1, len(whole)):.0f}",
            }
        )
    return records(rows)


def _faults(drive: dict[str, Any]) -> int:
    """Return the number of faults of the predictor in a drive."""
    return sum(n for fault, n in drive["faults"].items() if fault.startswith("predictor"))
