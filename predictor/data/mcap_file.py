"""An MCAP file of a drive: what was observed, what was predicted, and where the robot was.

The file is a bag of ROS 2 in the format MCAP, which Foxglove opens as it is, and
`predictor.data.bags` reads. All poses and maps are given in the frame `MAP`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.atomic_file import replacing
from foresee.infra.errors import LineError
from foresee.mapping.grid import UNKNOWN, GridFrame, OccupancyGrid
from foresee.mapping.scan import Scan
from foresee.prediction import Prediction

MAP, ROBOT, LASER = "map", "base_link", "laser"
"""Frames of the map, of the car's centre, and of the LIDAR."""
OBSERVED, PREDICTED, CONFIDENCE = "/observed", "/predicted", "/confidence"
POSE, PATH, PLAN, SCAN = "/pose", "/path", "/plan", "/scan"
TRANSFORMS, MOUNT = "/tf", "/tf_static"
TYPES = {
    OBSERVED: "nav_msgs/msg/OccupancyGrid",
    PREDICTED: "nav_msgs/msg/OccupancyGrid",
    CONFIDENCE: "nav_msgs/msg/OccupancyGrid",
    POSE: "geometry_msgs/msg/PoseStamped",
    PATH: "nav_msgs/msg/Path",
    PLAN: "nav_msgs/msg/Path",
    SCAN: "sensor_msgs/msg/LaserScan",
    TRANSFORMS: "tf2_msgs/msg/TFMessage",
    MOUNT: "tf2_msgs/msg/TFMessage",
}
"""Topic → type of its messages."""
APART = 0.5
"""Distance from one pose of the driven path to the next [m]."""
HEIGHTS = {OBSERVED: -0.02, PREDICTED: -0.04, CONFIDENCE: -0.06}
"""Height of each map [m]: all are drawn below path and scan, and predicted cells below observed
ones."""
LATEST = 2**31
"""Time from which on a stamp of ROS cannot hold it [s]."""


class McapError(LineError):
    """An MCAP file cannot be written; the message is one line."""


class McapFile:
    """An MCAP file that is being written. Times are in seconds, and must not decrease.

    Args:
        writer: open writer of rosbags.
        store: types of messages of rosbags.
    """

    def __init__(self, writer: Any, store: Any) -> None:
        self._writer, self._store = writer, store
        self._connections: dict[str, Any] = {}
        self._driven: list[Any] = []
        self._last = (math.inf, math.inf)

    def place(self, time: float, pose: NDArray[np.float64], frame: str) -> None:
        """Write where a frame is: /tf and /pose.

        Args:
            time: time of the pose [s].
            pose: x, y, yaw of the frame in the map, (3,) [m, m, rad].
            frame: `ROBOT` or `LASER`.
        """
        x, y, yaw = (float(value) for value in pose[:3])
        stamped = self._make(POSE, self._header(time), self._pose(x, y, yaw))
        self._transform(TRANSFORMS, time, MAP, frame, (x, y, yaw))
        self._write(POSE, time, stamped)
        if math.dist((x, y), self._last) >= APART:
            self._driven.append(stamped)
            self._last = x, y

    def mount(self, time: float, mount: tuple[float, float, float]) -> None:
        """Write where the LIDAR is on the robot: /tf_static.

        Args:
            time: time of the first message [s].
            mount: x, y, yaw of the LIDAR in the robot's frame [m, m, rad].
        """
        self._transform(MOUNT, time, ROBOT, LASER, mount)

    def scan(self, time: float, scan: Scan) -> None:
        """Write a scan; its mount is not part of the message."""
        last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
        angles = (scan.angle_min, last, scan.angle_increment)
        ranges, none = scan.ranges.astype(np.float32), np.zeros(0, np.float32)
        limits = (0.0, scan.range_max)
        header = self._header(time, LASER)
        self._write(SCAN, time, self._make(SCAN, header, *angles, 0.0, 0.0, *limits, ranges, none))

    def observed(self, time: float, known: OccupancyGrid) -> None:
        """Write the whole observed map, and the path driven so far."""
        self._grid(OBSERVED, time, known.frame, known.cells)
        self._write(PATH, time, self._make(PATH, self._header(time), self._driven))

    def predicted(self, time: float, prediction: Prediction) -> None:
        """Write a prediction: the probability of being occupied, and the confidence [%].

        Cells without a prediction (a confidence of 0), and those that most likely can never be
        observed, are -1: they are neither free nor occupied.
        """
        never = 1.0 - prediction.p_free - prediction.p_occupied
        shown = (prediction.confidence > 0.0) & (never <= 0.5)
        cells = np.where(shown, _percent(prediction.p_occupied), np.int8(UNKNOWN))
        self._grid(PREDICTED, time, prediction.frame, cells)
        self._grid(CONFIDENCE, time, prediction.frame, _percent(prediction.confidence))

    def plan(self, time: float, states: NDArray[np.float64]) -> None:
        """Write a plan, of which the states (n, 3 or more) begin with x, y, yaw [m, m, rad]."""
        header = self._header(time)
        poses = [self._make(POSE, header, self._pose(*map(float, state[:3]))) for state in states]
        self._write(PLAN, time, self._make(PLAN, header, poses))

    def _grid(self, topic: str, time: float, frame: GridFrame, cells: NDArray[np.int8]) -> None:
        rows, cols = frame.shape
        header = self._header(time)
        origin = self._pose(*frame.origin, 0.0, HEIGHTS[topic])
        info = self._of(
            "nav_msgs/msg/MapMetaData", header.stamp, frame.resolution, cols, rows, origin
        )
        self._write(topic, time, self._make(topic, header, info, cells.reshape(-1)))

    def _transform(
        self, topic: str, time: float, parent: str, child: str, pose: tuple[float, float, float]
    ) -> None:
        x, y, yaw = pose
        vector = self._of("geometry_msgs/msg/Vector3", x, y, 0.0)
        transform = self._of("geometry_msgs/msg/Transform", vector, self._turn(yaw))
        entry = self._of(
            "geometry_msgs/msg/TransformStamped", self._header(time, parent), child, transform
        )
        self._write(topic, time, self._make(topic, [entry]))

    def _pose(self, x: float, y: float, yaw: float, height: float = 0.0) -> Any:
        point = self._of("geometry_msgs/msg/Point", x, y, height)
        return self._of("geometry_msgs/msg/Pose", point, self._turn(yaw))

    def _turn(self, yaw: float) -> Any:
        half = 0.5 * yaw
        return self._of("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))

    def _header(self, time: float, frame: str = MAP) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(time), 10**9)
        stamp = self._of("builtin_interfaces/msg/Time", seconds, nanoseconds)
        return self._of("std_msgs/msg/Header", stamp, frame)

    def _make(self, topic: str, *fields: Any) -> Any:
        return self._of(TYPES[topic], *fields)

    def _of(self, kind: str, *fields: Any) -> Any:
        return self._store.types[kind](*fields)

    def _write(self, topic: str, time: float, message: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, TYPES[topic], typestore=self._store
            )
        data = self._store.serialize_cdr(message, TYPES[topic])
        self._writer.write(self._connections[topic], _nanoseconds(time), data)


@contextmanager
def writing_mcap(path: Path, about: Mapping[str, Any]) -> Iterator[McapFile]:
    """Open an MCAP file to write it, whole or not at all.

    Args:
        path: path of the file, in a folder that exists.
        about: how the file was made, plain data; rosbags calls it the custom data of a bag.

    Raises:
        McapError: if rosbags is not installed.
    """
    try:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise McapError(
            "MCAP files are written by rosbags: pip install 'foresee-nav[bags]'"
        ) from None
    with (
        replacing(path) as temporary,
        TemporaryDirectory(prefix=f"{path.name}.", suffix=".tmp", dir=path.parent) as folder,
    ):
        # rosbags writes a folder with the MCAP file and a file about it, which repeats its summary.
        bag = Path(folder) / "bag"
        writer = Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        for name, value in about.items():
            writer.set_custom_data(name, json.dumps(value))
        with writer:
            yield McapFile(writer, get_typestore(Stores.ROS2_HUMBLE))
        os.replace(bag / "bag.mcap", temporary)


def _nanoseconds(time: float) -> int:
    """Return a time [s] in nanoseconds.

    Raises:
        McapError: if a stamp of ROS cannot hold it.
    """
    if not 0.0 <= time < LATEST:
        raise McapError(f"the time {time} s is no stamp of ROS, which lie from 0 to 2^31 s")
    return round(1e9 * time)


def _percent(share: NDArray[np.float32]) -> NDArray[np.int8]:
    """Return shares in [0, 1] as whole percentages."""
    return np.rint(100.0 * share).astype(np.int8)
