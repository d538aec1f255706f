"""Rates and times of single kernels and calls: ray casting, mapping, risk map, prediction."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance import sized_maps as places
from benchmarks.studies.performance.stage_times import Measure, measure, timed
from foresee.mapping.grid import OccupancyGrid
from foresee.mapping.kernels import njit
from foresee.prediction import Prediction, View
from planner.navigator_config import NavigatorConfig
from planner.risk.ask_predictor import FIRST_DEADLINE, Asker
from planner.risk.distance_transform import distance_field
from planner.risk.predictor_process import PredictorProcess
from planner.risk.risk_map import RiskMap
from predictor.compact import Compact
from predictor.recording.rescan import rescanned
from predictor.registry import load_predictor
from sim import Lidar, LidarConfig
from sim.buildings import task_in
from sim.lidar import cast_rays
from sim.world import World

SCANS = 1000
"""Number of scans in a round of ray casting."""
THREADS = (1, 2)
"""Numbers of threads on which rays are cast."""
ROUNDS = 25
"""Number of rounds, whose median time is used."""
REPEATS = 500
"""Number of calls of a kernel that is timed call by call."""
VIEWS = 50
"""Number of views about which a predictor is asked."""
RISK_MAPS = 200
"""Number of risk maps that are timed."""


def maps(seed: int) -> dict[str, World]:
    """Return name → map for the two maps on which rays and scans are measured."""
    task = task_in("corridor", seed)
    return {
        "corridor 1000²": places.corridors(task, 1000),
        "cluttered 3000²": places.cluttered(3000, seed),
    }


def rays(seed: int) -> dict[str, Measure]:
    """Measure the rays per second of the ray caster on one and two threads.

    A scan has 1081 beams. In the case "on ways", each scan is 0.25 m from the one before, as for a
    driving car, with up to 20 scans on a straight line, so that the map around is mostly in the
    processor's caches. In the case "fresh places", each scan is at another random place of the map.
    The threads cast the same scans in different orders, and all rounds are the same.
    """
    lidar, rates = Lidar(), {}
    for name, world in maps(seed).items():
        fresh = places.anywhere(world, SCANS)
        for where, poses in (("on ways", places.on_ways(world, SCANS)), ("fresh places", fresh)):
            for threads, rate in _rates(lidar, world, poses).items():
                rates[f"rays, {where}, {name}, {threads} thread{'s' if threads > 1 else ''}"] = rate
    return rates


def _rates(lidar: Lidar, world: World, poses: NDArray[np.float64]) -> dict[int, Measure]:
    """Measure the rays per second on each number of `THREADS`."""
    config, frame = lidar.config, world.grid.frame
    angles = config.angle_min + config.angle_increment * np.arange(config.beams)
    beams = np.column_stack([np.cos(angles), np.sin(angles)])
    starts = np.column_stack([(poses[:, :2] - frame.origin) / frame.resolution, poses[:, 2]])
    longest = config.range_max / frame.resolution

    def cast(own: NDArray[np.float64]) -> None:
        _casts(world.skips, world.grid.cells, own, beams, longest)

    taken: dict[int, list[float]] = {count: [] for count in THREADS}
    with ThreadPoolExecutor(max(THREADS)) as pool:
        # The numbers take turns, so that other load affects all; the first round is not timed.
        for turn in range(ROUNDS + 1):
            for count, times in taken.items():
                own = [np.roll(starts, i * len(starts) // count, axis=0) for i in range(count)]
                started = time.perf_counter()
                list(pool.map(cast, own))
                if turn:
                    times.append(time.perf_counter() - started)
    once = len(starts) * config.beams
    return {
        count: measure(
            1e-6 * count * once / float(np.median(times)), "million/s", count * once * ROUNDS
        )
        for count, times in taken.items()
    }


@njit(cache=True, nogil=True)
def _casts(skips, cells, starts, beams, longest):  # type: ignore[no-untyped-def]
    # All scans are cast in one call, so that switching between threads in Python takes no time.
    for i in range(starts.shape[0]):
        cast_rays(skips, cells, starts[i, 0], starts[i, 1], starts[i, 2], beams, longest)


def mapping(seed: int) -> dict[str, Measure]:
    """Measure the scans (1081 beams of up to 20 m) that are integrated per second on one thread."""
    lidar, rates = Lidar(), {}
    window = 2 * (lidar.config.range_max + 0.5)
    for name, world in maps(seed).items():
        poses = places.anywhere(world, REPEATS)
        scans = [lidar.scan(world, pose) for pose in poses]
        known = OccupancyGrid(world.grid.frame, window)
        for pose in poses:
            # The map grows here, so that it does not grow while integration is timed.
            known.cover(known.frame.square(float(pose[0]), float(pose[1]), window))

        def integrate(
            i: int, known: OccupancyGrid = known, scans: Any = scans, poses: Any = poses
        ) -> None:
            known.integrate(scans[i], poses[i])

        median = timed(integrate, REPEATS)["median_ms"]
        rates[f"mapping, {name}"] = measure(1e3 / median, "scans/s", REPEATS)
    return rates


def distance(seed: int) -> dict[str, Measure]:
    """Time the distance transform of maps of 200 × 200 cells, observed in a drive."""
    task = task_in("corridor", seed)
    masks = [~crop.free for crop in places.crops_along(task, REPEATS)]
    return {"distance transform 200²": _time(timed(lambda i: distance_field(masks[i]), len(masks)))}


def risk(seed: int) -> dict[str, Measure]:
    """Time the computation of the risk map from the observed map and the prediction."""
    config = NavigatorConfig(reliance=0.05)
    task = task_in("corridor", seed)
    poses = np.column_stack([places.along(task, RISK_MAPS), np.zeros(RISK_MAPS)])
    rng = np.random.default_rng(0)
    (*_, (known, _)) = rescanned(task, poses, config.window, LidarConfig(), rng, 1)
    squares = [known.frame.square(x, y, config.predicted_side) for x, y in poses[:, :2]]
    views = [
        View(known.crop(square), pose[:3]) for square, pose in zip(squares, poses, strict=True)
    ]
    predictor = Compact()
    beliefs = [predictor.predict(view) for view in views]
    near = [known.crop(known.frame.square(x, y, config.risk_side)) for x, y in poses[:, :2]]

    def build(i: int) -> RiskMap:
        return RiskMap.from_prediction(near[i], beliefs[i], config.reliance)

    return {"risk map 200²": _time(timed(build, RISK_MAPS))}


def asking(seed: int) -> dict[str, Measure]:
    """Time a prediction of `compact` as the planner asks for it, in a thread and in a process.

    All run on one core. The views are those of a drive, and each is used several times.
    """
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    in_process = PredictorProcess(load_predictor, "compact")
    try:
        in_thread = Asker(load_predictor("compact"))
        task = task_in("corridor", seed)
        states = np.column_stack([places.along(task, VIEWS), np.zeros(VIEWS)])
        views = [
            View.of(known, state[:3], 10.0, in_thread.context_side)
            for known, state in rescanned(
                task, states, 5.0, LidarConfig(), np.random.default_rng(0), 1
            )
        ]
        askers: dict[str, Asker | PredictorProcess] = {
            "in a thread": in_thread,
            "in a process of its own": in_process,
        }
        return {
            f"prediction, {name}": _time(timed(partial(_ask, asker, views), REPEATS))
            for name, asker in askers.items()
        }
    finally:
        in_process.close()
        os.sched_setaffinity(0, cores)


def _ask(asker: Asker | PredictorProcess, views: list[View], i: int) -> Prediction:
    return asker.ask(views[i % len(views)], FIRST_DEADLINE)


def _time(spread: dict[str, float]) -> Measure:
    return measure(spread["median_ms"], "ms", int(spread["samples"]), p99=spread["p99_ms"])
