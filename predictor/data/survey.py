"""Frames of a robot's log, with the map of all scans of the log as truth.

For the truth, hits and crossings of each cell are counted over all scans of the log. A cell is
occupied if at least a quarter of them are hits, and else free if it was crossed. The order of the
scans does not matter, so people who walked past are not in the map: where a person stood for two
scans, twenty others saw the floor. The threshold is a quarter, as in GMapping, because walls at a
grazing angle are crossed more often than hit.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.grid import GridFrame, OccupancyGrid, mark_beams, world_hash
from foresee.mapping.scan import Scan
from predictor.data.bag_config import BagConfig
from predictor.data.frame_set import WINDOW, Recording, write_trajectory
from predictor.data.laser_log import LaserLog, LogError
from predictor.data.log_files import read_log, site_name
from predictor.data.squares import decode_cells, truth_codes

HITS = 0.25
"""Least share of hits among hits and crossings of an occupied cell."""
REACH = 20.0
"""Range of the paper's LIDAR; longer ranges are cut off there [m]."""
LARGEST = 1000.0
"""Largest extent of a log's poses [m]; the map then takes 0.4 GB."""


def log_settings(bag: BagConfig) -> dict[str, Any]:
    """Return all settings that decide the frames of a log."""
    return {"reach": REACH, "window": WINDOW, "hits": HITS, "bag": asdict(bag)}


def make_log(folder: Path, bag: BagConfig, path: Path) -> dict[str, Any]:
    """Read a log, write its frames, and return their facts for the manifest.

    Args:
        folder: folder of the set.
        bag: topics to read from a bag.
        path: path of the log.

    Raises:
        LogError: if it cannot be read.
    """
    log = read_log(path, bag)
    try:
        recording = record(log)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None
    about = {
        "split": "physical",
        "map": log.name,
        "world": world_hash(decode_cells(recording.truth)),
        "clock": log.times is not None,
        "skipped": log.skipped,
        "notes": list(log.notes),
    }
    return write_trajectory(folder, site_name(path), recording.arrays(), about)


def record(log: LaserLog) -> Recording:
    """Return the frames of a log, one for each scan.

    Speed and actions are NaN, since a log has neither; times are NaN if it has no clock.

    Raises:
        LogError: if the log's map has no free cell, or is too large for a building.
    """
    frame = frame_around(log.poses, REACH)
    scans = [clipped(scan, REACH) for scan in log.scans]
    truth = surveyed(frame, scans, log.poses)
    if not (truth == 0).any():
        raise LogError("no cell of its map is free")
    recording = Recording(frame, truth)
    first = frame.square(float(log.poses[0, 0]), float(log.poses[0, 1]), 2 * REACH)
    whole, near = OccupancyGrid(first, 2 * REACH), OccupancyGrid(first, WINDOW)
    times = np.full(len(log), np.nan) if log.times is None else log.times - log.times[0]
    for scan, pose, time in zip(scans, log.poses, times, strict=True):
        whole.integrate(scan, pose)
        near.integrate(scan, pose)
        recording.add(whole, near, np.append(pose, np.nan), np.full(2, np.nan), float(time))
    return recording


def surveyed(frame: GridFrame, scans: list[Scan], poses: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the map of a whole log as codes, (rows, columns).

    Occupied cells without a free neighbour are no surface: they are 2, like the inside of walls.

    Args:
        frame: frame of the map.
        scans: all scans of the log.
        poses: pose of each scan, (n, 3).
    """
    hits, crossings = (np.zeros(frame.shape, dtype=np.int32) for _ in range(2))
    for scan, pose in zip(scans, poses, strict=True):
        where = (float(pose[0]), float(pose[1]), float(pose[2]))
        x, y, _ = scan.sensor_pose(*where)
        square = frame.square(x, y, 2 * scan.range_max + 4 * frame.resolution)
        marks = mark_beams(scan, where, square)
        here, there = frame.overlap(square)
        hits[here] += marks[there] == 2
        crossings[here] += marks[there] == 1
    occupied = (hits > 0) & (hits >= HITS * (hits + crossings))
    free = (crossings > 0) & ~occupied
    surface = occupied & binary_dilation(free, np.ones((3, 3), dtype=bool))
    return truth_codes(free, surface)


def frame_around(poses: NDArray[np.float64], reach: float) -> GridFrame:
    """Return the frame of the map of a log.

    Args:
        poses: x, y, yaw of the scans, (n, 3) [m, m, rad].
        reach: range of the LIDAR [m], by which the frame is larger than the poses.

    Raises:
        LogError: if the poses lie more than `LARGEST` apart.
    """
    extent = float(np.ptp(poses[:, :2], axis=0).max())
    if extent > LARGEST:
        raise LogError(f"the poses lie {extent:.4g} m apart, at most {LARGEST:.0f} m can be mapped")
    low = np.floor((poses[:, :2].min(axis=0) - reach) / RESOLUTION) - 4
    high = np.ceil((poses[:, :2].max(axis=0) + reach) / RESOLUTION) + 4
    cols, rows = (high - low).astype(int)
    x, y = (low * RESOLUTION).tolist()
    return GridFrame(RESOLUTION, (x, y), (int(rows), int(cols)))


def clipped(scan: Scan, reach: float) -> Scan:
    """Return a scan with a smaller sensor range [m]; beams with longer ranges are free up to it."""
    return replace(scan, range_max=min(reach, scan.range_max))
