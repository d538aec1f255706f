"""Rates and times of single kernels: ray casting, mapping, distance transform, risk map."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from benchmarks.studies.performance import sized_maps as places
from benchmarks.studies.performance.growth import believing
from benchmarks.studies.performance.stage_times import Measure, measure, timed
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from foresee.mapping.kernels import njit
from planner.risk.distance_transform import distance_field
from sim import Lidar
from sim.buildings import task_in
from sim.lidar import cast_rays
from sim.world import World

SCANS = 1000
"""Number of scans in a round of ray casting."""
THREADS = (1, 2)
"""Numbers of threads on which rays are cast."""
ROUNDS = 25
"""Number of rounds, whose median time is used."""
CHECKED_POSES, CHECKED_BEAMS = 20, 54
"""Number of scans that are compared with exact ranges, and number of beams of each."""
REPEATS = 500
"""Number of calls of a kernel that is timed call by call."""


def maps(seed: int) -> dict[str, World]:
    """Return name → map for the two maps on which rays and scans are measured."""
    task = task_in("corridor", seed)
    return {
        "corridor 1000²": places.corridors(task, 1000),
        "cluttered 3000²": places.cluttered(3000, seed),
    }


def rays(seed: int) -> dict[str, Measure]:
    """Measure the rays per second of the ray caster on one and two threads, and the error of scans.

    A scan has 1081 beams. In the case "on ways", each scan is 0.25 m from the one before, as for a
    driving car, with up to 20 scans on a straight line, so that the map around is mostly in the
    processor's caches. In the case "fresh places", each scan is at another random place of the map.
    The threads cast the same scans in different orders, and all rounds are the same.
    """
    lidar, found = Lidar(), {}
    for name, world in maps(seed).items():
        fresh = places.anywhere(world, SCANS)
        for where, poses in (("on ways", places.on_ways(world, SCANS)), ("fresh places", fresh)):
            for threads, rate in _rates(lidar, world, poses).items():
                found[f"rays, {where}, {name}, {threads} thread{'s' if threads > 1 else ''}"] = rate
        worst, compared = error(lidar, world, fresh[:CHECKED_POSES])
        found[f"rays, {name}, largest error"] = measure(worst, "m", compared)
    return found


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


def error(lidar: Lidar, world: World, poses: NDArray[np.float64]) -> tuple[float, int]:
    """Return the largest error of a range [m], and the number of beams that were compared.

    The error is infinite if a beam returns although it should not, or the other way round.
    """
    worst, compared = 0.0, 0
    frame = world.grid.frame
    for pose in poses:
        scan = lidar.scan(world, pose)
        x, y, bearing = scan.sensor_pose(*(float(value) for value in pose))
        chosen = np.linspace(0, len(scan.ranges) - 1, CHECKED_BEAMS).astype(int)
        angles = bearing + scan.angle_min + scan.angle_increment * chosen
        u, v = (x - frame.origin[0]) / frame.resolution, (y - frame.origin[1]) / frame.resolution
        exact = exact_ranges(world.grid.cells, u, v, angles, scan.range_max / frame.resolution)
        for got, want in zip(scan.ranges[chosen], exact, strict=True):
            if want is None:
                continue
            compared += 1
            if math.isfinite(got) and math.isfinite(want):
                worst = max(worst, abs(float(got) - frame.resolution * want))
            elif not (got == want or (math.isnan(got) and math.isnan(want))):
                worst = math.inf
    return worst, compared


def exact_ranges(
    cells: NDArray[np.int8], x: float, y: float, angles: NDArray[np.float64], longest: float
) -> list[float | None]:
    """Compute the exact range of each beam [cells] by brute force.

    Each beam is intersected with each solid cell that has a free neighbour within range.

    Args:
        cells: cells of the map, (rows, columns).
        x: position of the sensor along the columns [cells].
        y: position of the sensor along the rows [cells].
        angles: directions of the beams, (n,) [rad].
        longest: range of the sensor [cells].

    Returns:
        Range of each beam; infinity if nothing is in range; NaN if the beam ends in unknown space;
        None if the beam passes a corner of a cell within 1e-9 cells, so that rounding decides.
    """
    reach = math.ceil(longest) + 2
    top, left = max(0, math.floor(y) - reach), max(0, math.floor(x) - reach)
    near = cells[top : math.floor(y) + reach + 1, left : math.floor(x) + reach + 1]
    solid = np.pad(near, 1, constant_values=UNKNOWN)
    if solid[math.floor(y) - top + 1, math.floor(x) - left + 1] != FREE:
        return [math.nan] * len(angles)
    rows, cols = np.nonzero(
        (solid != FREE) & binary_dilation(solid == FREE, np.ones((3, 3), dtype=bool))
    )
    kinds = solid[rows, cols]
    low_x, low_y = cols - 1 + left - x, rows - 1 + top - y
    found: list[float | None] = []
    for angle in angles:
        with np.errstate(divide="ignore"):
            tx = np.sort(np.stack([low_x, low_x + 1]) / math.cos(angle), axis=0)
            ty = np.sort(np.stack([low_y, low_y + 1]) / math.sin(angle), axis=0)
        enter, leave = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
        met = (enter < leave) & (leave > 0)
        first = np.flatnonzero(met)[np.argmin(enter[met])]
        at = float(enter[first])
        # Only corners before the end of the beam count, not those behind the wall.
        corner = (np.abs(leave - enter) < 1e-9) & (leave > 0) & (enter <= at + 1e-9)
        if corner.any():
            found.append(None)
        elif at >= longest:
            found.append(math.inf)
        else:
            found.append(at if kinds[first] == OCCUPIED else math.nan)
    return found


def mapping(seed: int) -> dict[str, Measure]:
    """Measure the scans (1081 beams of up to 20 m) that are integrated per second on one thread."""
    lidar, found = Lidar(), {}
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
        found[f"mapping, {name}"] = measure(1e3 / median, "scans/s", REPEATS)
    return found


def distance(seed: int) -> dict[str, Measure]:
    """Time the distance transform of maps of 200 × 200 cells, observed in a drive."""
    task = task_in("corridor", seed)
    masks = [~crop.free for crop in places.crops_along(task, REPEATS)]
    return {"distance transform 200²": _time(timed(lambda i: distance_field(masks[i]), len(masks)))}


def risk(seed: int) -> dict[str, Measure]:
    """Time the computation of the risk map from the observed map and the prediction."""
    task = task_in("corridor", seed)
    return {"risk map 200²": _time(believing(task, 5.0, 2.0)["risk"])}


def _time(spread: dict[str, float]) -> Measure:
    return measure(spread["median_ms"], "ms", int(spread["samples"]), p99=spread["p99_ms"])
