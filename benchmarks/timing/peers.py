"""The programs that a user would pick instead, each at its best, beside ours in one run.

Each stage gives its own callable and those of the peers; a few calls of one follow a few of
another, so that whatever else the machine does meets all alike, and each has the caches to itself.
Those of the MPC are in `benchmarks.timing.peers_mpc`. All come with the extra `peers`.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.runs.drive import task_in
from benchmarks.timing.sized_maps import along, crops_along
from benchmarks.timing.timing import OURS, beside_ours
from planner.risk.distance_transform import distance_field
from predictor.compact import Compact
from predictor.mapping.car_limits import CarLimits
from sim import Lidar, LidarConfig
from sim.task import Task
from sim.world import World

Call = Callable[[int], Any]
TOGETHER = 10
"""Calls of one program that follow one another."""


def compare(calls: dict[str, Call], repeats: int) -> dict[str, dict[str, float]]:
    """Time some callables, a few calls of one after a few of another.

    Before those that count, one does not: it fetches back what the others pushed out of the caches.

    Args:
        calls: by name; `OURS` among them.
        repeats: calls of each that count, with 0, 1, …

    Returns:
        As `beside_ours`.
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
"""Calls of each that count."""


def beside(stage: str, seed: int) -> dict[str, dict[str, float]]:
    """Time one of `STAGES` and its peers in a building of corridors; see `compare`."""
    task = task_in("corridor", seed, CarLimits())
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
    """Cast one scan of 1081 beams, 270°, 20 m; octomap and raycast2D find the cell hit."""
    import octomap
    from raycast2D import Lidar2D

    # At the robot's own centre, where the peers have it.
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
        # A heading of 0 is along its -y.
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
        # Image rows run down, and dark is occupied.
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
    """Integrate one scan into a map of 0.05 m, each cell once, with all 20 m of its rays."""
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
    """Compute the exact distance transform of a window of 200 × 200 cells."""
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
    """Predict a 10 m square: the same network, by the two runtimes."""
    ours, torch = Compact(), Compact(runtime="torch")
    return {
        OURS: lambda i: ours.predict(crops[i], poses[i]),
        "PyTorch, eager": lambda i: torch.predict(crops[i], poses[i]),
    }
