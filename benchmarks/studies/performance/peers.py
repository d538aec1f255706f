"""Comparison of stages with other libraries ("peers") for the same task, each at its best settings.

For each stage, the calls of this project and of the peers take turns, a few calls each: other load
of the machine then affects all equally, and each has the caches to itself for a while. The MPC is
compared in `peers_mpc`. The extra `peers` installs all these libraries.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.performance.sized_maps import along, crops_along
from benchmarks.studies.performance.stage_times import OURS, beside_ours
from foresee.prediction import View
from planner.risk.distance_transform import distance_field
from predictor.compact import Compact
from sim import Lidar, LidarConfig
from sim.buildings import task_in
from sim.task import Task
from sim.world import World

Call = Callable[[int], Any]
"""Function of the number of a call."""
TOGETHER = 10
"""Number of consecutive calls of one library."""


def compare(calls: dict[str, Call], repeats: int) -> dict[str, dict[str, float]]:
    """Time some functions, which take turns of a few calls each.

    Each turn starts with a call that is not timed, which brings data back into the caches.

    Args:
        calls: name → function; `OURS` must be among the names.
        repeats: number of timed calls of each, with arguments 0, 1, …

    Returns:
        Times as in `beside_ours`.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for first in range(0, repeats, TOGETHER):
        for name, call in calls.items():
            call(first)
            for i in range(first, min(first + TOGETHER, repeats)):
                started = time.perf_counter()
                call(i)
                taken[name].append(1e3 * (time.perf_counter() - started))
    return beside_ours(taken)


STAGES = ("rays", "mapping", "distance transform", "prediction")
REPEATS = 200
"""Number of timed calls of each function."""


def beside(stage: str, seed: int) -> dict[str, dict[str, float]]:
    """Time one of `STAGES` and its peers in a building of the family `corridor`; see `compare`."""
    task = task_in("corridor", seed)
    poses = along(task, REPEATS)
    if stage == "rays":
        return compare(rays(task.world, poses), REPEATS)
    if stage == "mapping":
        return compare(mapping(task, poses), REPEATS)
    crops = crops_along(task, REPEATS)
    if stage == "prediction":
        return compare(predictions(crops, poses), REPEATS)
    return compare(distances([crop.free for crop in crops]), REPEATS)


def rays(world: World, poses: NDArray[np.float64]) -> dict[str, Call]:
    """Return functions that cast a scan of 1081 beams, 270° and 20 m.

    raycast2D returns the cell that is hit, not the exact range.
    """
    from raycast2D import Lidar2D

    # The LIDAR is at the robot's centre, as for the peer.
    lidar, frame = Lidar(LidarConfig(mount=(0.0, 0.0, 0.0))), world.grid.frame
    image = np.where(world.grid.occupied, 0, 255).astype(np.uint8)
    reach = round(lidar.config.range_max / frame.resolution)
    peer = Lidar2D(lidar.config.beams, 270, reach, occupancy_grid=image)
    pixels = [frame.cell(x, y)[::-1] for x, y in poses[:, :2]]

    def by_raycast2d(i: int) -> NDArray[Any]:
        # raycast2D's heading of 0 is along its -y.
        heading = float(poses[i, 2]) + np.pi / 2
        return np.asarray(peer.scan((*pixels[i], heading), only_true_collisions=False))

    return {OURS: lambda i: lidar.scan(world, poses[i]), "raycast2D": by_raycast2d}


def mapping(task: Task, poses: NDArray[np.float64]) -> dict[str, Call]:
    """Return functions that integrate a scan into a map of 0.05 m, with rays of up to 20 m.

    Each cell is updated once per scan.
    """
    import octomap

    lidar, known = Lidar(), task.blank(60.0)
    resolution = known.frame.resolution
    scans = [lidar.scan(task.world, pose) for pose in poses]
    clouds, origins = [], []
    for scan, pose in zip(scans, poses, strict=True):
        x, y, bearing = scan.sensor_pose(*pose[:3])
        angle = bearing + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        reach = np.where(np.isnan(scan.ranges), 0.0, np.minimum(scan.ranges, scan.range_max))
        flat = np.full(len(angle), 0.5 * resolution)
        clouds.append(np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle), flat]))
        origins.append(np.array([x, y, 0.5 * resolution]))
    tree = octomap.OcTree(resolution)
    once: dict[str, Any] = {"maxrange": -1.0, "lazy_eval": True, "discretize": True}
    return {
        OURS: lambda i: known.integrate(scans[i], poses[i]),
        "octomap-python": lambda i: tree.insertPointCloud(clouds[i], origins[i], **once),
    }


def distances(masks: list[NDArray[np.bool_]]) -> dict[str, Call]:
    """Return functions that compute the exact distance transform of masks of 200 × 200 cells."""
    import cv2
    from scipy.ndimage import distance_transform_edt

    cv2.setNumThreads(1)
    images = [np.where(mask, 0, 255).astype(np.uint8) for mask in masks]
    return {
        OURS: lambda i: distance_field(masks[i]),
        "scipy": lambda i: distance_transform_edt(images[i]),
        "OpenCV, precise": lambda i: cv2.distanceTransform(
            images[i], cv2.DIST_L2, cv2.DIST_MASK_PRECISE
        ),
    }


def predictions(crops: list[Any], poses: NDArray[np.float64]) -> dict[str, Call]:
    """Return functions that predict a 10 m square with the same network in two runtimes."""
    ours, torch = Compact(), Compact(runtime="torch")
    views = [View(crop, pose) for crop, pose in zip(crops, poses, strict=True)]
    return {
        OURS: lambda i: ours.predict(views[i]),
        "PyTorch, eager": lambda i: torch.predict(views[i]),
    }
