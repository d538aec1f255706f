"""Comparison of stages with other libraries ("peers") for the same task, each at its best settings.

For each stage, the calls of this project and of the peers take turns, a few calls each: other load
of the machine then affects all equally, and each has the caches to itself for a while. The MPC is
compared in `peers_mpc`. The extra `peers` installs all these libraries.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
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

    octomap and raycast2D return the cell that is hit, not the exact range.
    """
    import octomap
    from raycast2D import Lidar2D

    # The LIDAR is at the robot's centre, as for the peers.
    lidar, frame = Lidar(LidarConfig(mount=(0.0, 0.0, 0.0))), world.grid.frame
    angles = lidar.config.angle_min + lidar.config.angle_increment * np.arange(lidar.config.beams)
    image = np.where(world.grid.occupied, 0, 255).astype(np.uint8)
    reach = round(lidar.config.range_max / frame.resolution)
    other = Lidar2D(lidar.config.beams, 270, reach, occupancy_grid=image)
    pixels = [frame.cell(x, y)[::-1] for x, y in poses[:, :2]]
    tree = octomap.OcTree(frame.resolution)
    rows, cols = np.nonzero(world.grid.occupied)
    xs, ys = frame.centres()
    for x, y in zip(xs[cols], ys[rows], strict=True):
        tree.updateNode(np.array([x, y, 0.5 * frame.resolution]), True, True)
    tree.updateInnerOccupancy()
    end = np.zeros(3)

    def by_octomap(i: int) -> NDArray[np.float64]:
        x, y, yaw = poses[i]
        ends = np.empty((len(angles), 2))
        origin = np.array([x, y, 0.5 * frame.resolution])
        rays = np.column_stack([np.cos(yaw + angles), np.sin(yaw + angles), np.zeros(len(angles))])
        for beam, ray in enumerate(rays):
            tree.castRay(origin, ray, end, True, lidar.config.range_max)
            ends[beam] = end[:2]
        return ends

    def by_raycast2d(i: int) -> NDArray[Any]:
        # raycast2D's heading of 0 is along its -y.
        heading = float(poses[i, 2]) + np.pi / 2
        return np.asarray(other.scan((*pixels[i], heading), only_true_collisions=False))

    return {
        OURS: lambda i: lidar.scan(world, poses[i]),
        "raycast2D": by_raycast2d,
        "octomap-python": by_octomap,
        "ir-sim": _irsim(world, poses, angles, lidar.config.range_max),
    }


def _irsim(
    world: World, poses: NDArray[np.float64], angles: NDArray[np.floating], longest: float
) -> Call:
    import irsim
    from PIL import Image

    frame = world.grid.frame
    wide, high = frame.size
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "map.png"
        # Rows of images run downwards, and dark pixels are occupied.
        Image.fromarray(np.where(world.grid.occupied[::-1], 0, 255).astype(np.uint8)).save(image)
        settings = Path(folder) / "world.yaml"
        settings.write_text(
            f"world: {{height: {high}, width: {wide}, obstacle_map: '{image}', "
            "collision_mode: 'unobstructed'}\n"
            "robot:\n  kinematics: {name: 'diff'}\n  shape: {name: 'circle', radius: 0.1}\n"
            f"  state: [{wide / 2}, {high / 2}, 0]\n  sensors:\n    - name: 'lidar2d'\n"
            f"      range_max: {longest}\n      angle_range: {angles[-1] - angles[0]}\n"
            f"      number: {len(angles)}\n"
        )
        env = irsim.make(str(settings), display=False, disable_all_plot=True, log_level="ERROR")
    sensor = env.robot.sensors[0]
    shift = np.array(frame.origin)

    def scan(i: int) -> NDArray[np.float64]:
        x, y = poses[i, :2] - shift
        sensor.step(np.array([[x], [y], [poses[i, 2]]]))
        return np.asarray(sensor.range_data)

    return scan


def mapping(task: Task, poses: NDArray[np.float64]) -> dict[str, Call]:
    """Return functions that integrate a scan into a map of 0.05 m, with rays of up to 20 m.

    Each cell is updated once per scan.
    """
    import octomap
    import pyoctomap

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
    tree, other = octomap.OcTree(resolution), pyoctomap.OcTree(resolution)
    once: dict[str, Any] = {"lazy_eval": True, "discretize": True}
    return {
        OURS: lambda i: known.integrate(scans[i], poses[i]),
        "octomap-python": lambda i: tree.insertPointCloud(
            clouds[i], origins[i], maxrange=-1.0, **once
        ),
        "pyoctomap": lambda i: other.insertPointCloud(
            clouds[i], origins[i], max_range=-1.0, **once
        ),
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
