"""Bags of ROS 1 and ROS 2, read without ROS by the package rosbags (the extra `bags`).

Scans are sensor_msgs/LaserScan. The pose of a scan comes from /tf, if that connects the map frame
with the laser; else from a topic of geometry_msgs/PoseStamped, PoseWithCovarianceStamped or
nav_msgs/Odometry, which gives the pose of the robot, the frame that /tf_static fixes the laser to.
Poses are interpolated at the times of the scans. Scans before the first pose, after the last, or in
a gap of more than a second are skipped and counted. All beams of a scan get the same pose: the
motion of the robot during a scan is ignored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.plain_yaml import read_yaml
from foresee.mapping.scan import Scan
from predictor.data import BAGS
from predictor.data.laser_log import LaserLog, LogError, cleaned
from predictor.data.transforms import Transforms

SCAN = "sensor_msgs/msg/LaserScan"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
)
STATIC = "/tf_static"
POSED = "(pose topic)"
"""Name used here for the frame in which the poses of a pose topic are given."""
MAX_METADATA = 1_000_000
"""Largest metadata file of a ROS 2 bag that is read [bytes]."""
LEVEL = math.cos(math.radians(10.0))
"""Cosine of the largest tilt at which a laser counts as level."""


@dataclass(frozen=True)
class BagConfig:
    """Topics to read from a bag.

    Attributes:
        scans: topic of the scans; None: the only one.
        poses: topic of the poses; None: /tf if it knows the map frame, else the only pose topic.
        map_frame: frame of /tf that poses are given in.
    """

    scans: str | None = None
    poses: str | None = None
    map_frame: str = "map"


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a file with one of its endings, or a folder of ROS 2."""
    return path.suffix in BAGS or (path / "metadata.yaml").is_file()


def read_bag(path: Path, config: BagConfig | None = None) -> LaserLog:
    """Read all scans of a bag that have a pose.

    Args:
        path: path of the file, or of a ROS 2 bag's folder.
        config: topics to read.

    Raises:
        LogError: if rosbags is not installed, the bag cannot be read, it has no scans or no poses,
            or several topics of them and `config` names none.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError("bags are read by rosbags: pip install 'foresee[bags]'") from None
    if not path.exists():
        raise LogError(f"{path}: no such file")
    described = path / "metadata.yaml"
    try:
        if described.is_file():
            # Checked first, since rosbags would expand any YAML.
            read_yaml(described, MAX_METADATA)
        # Old ROS 2 bags do not contain the layout of their messages.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_FOXY)) as reader:
            return _Bag(path, reader, config or BagConfig()).log()
    except LogError:
        raise
    except Exception as error:
        # On a damaged file rosbags raises exceptions of any kind.
        line = (str(error) or type(error).__name__).splitlines()[0]
        raise LogError(f"{path} cannot be read as a bag: {line}") from error


class _Bag:
    """An open bag."""

    def __init__(self, path: Path, reader: Any, config: BagConfig) -> None:
        self.path, self.reader, self.config = path, reader, config
        self.kinds = {c.topic: c.msgtype for c in reader.connections}

    def log(self) -> LaserLog:
        scans, times, frame, bad = self._scans()
        transforms = self._transforms()
        root = self._source(transforms, frame)
        try:
            positions, turns, known = transforms.look_up(root, frame, times)
        except KeyError:
            raise LogError(
                f"{self.path}: nothing leads from {root!r} to the laser's frame {frame!r}"
            ) from None
        if not known.any():
            raise LogError(f"{self.path}: no scan was taken within a second of two poses")
        matrices = turns.as_matrix()
        if (abs(matrices[known, 2, 2]) < LEVEL).any():
            raise LogError(f"{self.path}: the laser leans by more than 10°; level ones are read")
        yaw = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
        poses = np.column_stack([positions[:, :2], yaw])
        order = np.argsort(times, kind="stable")
        order = order[known[order]]
        kept = [scans[i] if matrices[i, 2, 2] > 0 else _mirrored(scans[i]) for i in order]
        skipped = {"bad ranges": bad, "scans without a pose": int((~known).sum())}
        name = self.path.name.removesuffix(self.path.suffix)
        return LaserLog(name, tuple(kept), poses[order], times[order], skipped)

    def _scans(self) -> tuple[list[Scan], NDArray[np.float64], str, int]:
        """Read the scans, their times [s], the laser's frame, and the number of bad ranges."""
        topic = self._chosen(self.config.scans, (SCAN,), "scans", "--scans")
        scans, times, bad, frame = [], [], 0, ""
        for message in self._messages(topic):
            ranges = np.asarray(message.ranges, dtype=np.float64)
            if not message.range_max > 0:
                raise LogError(f"{self.path}: {topic} gives a range_max of {message.range_max} m")
            beams = float(message.angle_min), float(message.angle_increment)
            if not np.isfinite(beams).all() or beams[1] == 0.0:
                raise LogError(
                    f"{self.path}: {topic} has beams from {beams[0]} rad on, {beams[1]} rad apart"
                )
            ranges, wrong = cleaned(ranges, float(message.range_min))
            bad += wrong
            scans.append(Scan(ranges, *beams, float(message.range_max)))
            times.append(_seconds(message.header.stamp))
            frame = message.header.frame_id.lstrip("/")
        if not scans:
            raise LogError(f"{self.path}: {topic} holds no scan")
        return scans, np.array(times), frame, bad

    def _transforms(self) -> Transforms:
        transforms = Transforms()
        for topic in [t for t, kind in self.kinds.items() if kind in TRANSFORMS]:
            for message in self._messages(topic):
                for entry in message.transforms:
                    where, turn = entry.transform.translation, entry.transform.rotation
                    transforms.add(
                        entry.header.frame_id.lstrip("/"),
                        entry.child_frame_id.lstrip("/"),
                        _seconds(entry.header.stamp),
                        (where.x, where.y, where.z),
                        (turn.x, turn.y, turn.z, turn.w),
                        fixed=topic == STATIC,
                    )
        return transforms

    def _source(self, transforms: Transforms, laser: str) -> str:
        """Return the frame that poses are given in, and add the poses of a pose topic."""
        root, wanted = self.config.map_frame, self.config.poses
        by_transforms = root in transforms.chain(laser)
        if wanted is None and by_transforms:
            return root
        if wanted is not None and self.kinds.get(wanted) in TRANSFORMS:
            if not by_transforms:
                there = ", ".join(transforms.chain(laser))
                raise LogError(
                    f"{self.path}: {wanted} leads from the laser to {there}, not to "
                    f"{root!r}; --map-frame says where to"
                )
            return root
        topic = self._chosen(wanted, POSES, "poses", "--poses")
        robot = transforms.carrier(laser)
        # The pose topic replaces what /tf says about the robot.
        transforms.edges.pop(robot, None)
        for message in self._messages(topic):
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
            at, turn = pose.position, pose.orientation
            transforms.add(
                POSED,
                robot,
                _seconds(message.header.stamp),
                (at.x, at.y, at.z),
                (turn.x, turn.y, turn.z, turn.w),
            )
        return POSED

    def _chosen(self, wanted: str | None, kinds: tuple[str, ...], what: str, flag: str) -> str:
        """Return the topic asked for, else the only one of some kinds."""
        have = ", ".join(f"{t} ({kind})" for t, kind in sorted(self.kinds.items())) or "none"
        fitting = [topic for topic, kind in sorted(self.kinds.items()) if kind in kinds]
        if wanted is not None:
            if wanted not in fitting:
                raise LogError(f"{self.path}: {wanted} is no topic of {what}; topics: {have}")
            return wanted
        if not fitting:
            raise LogError(f"{self.path} has no {what}; topics: {have}")
        if len(fitting) > 1:
            raise LogError(
                f"{self.path} has several topics of {what}: {', '.join(fitting)}; "
                f"choose one by {flag} of predictor.dataset"
            )
        return fitting[0]

    def _messages(self, topic: str) -> Iterator[Any]:
        connections = [c for c in self.reader.connections if c.topic == topic]
        for connection, _, raw in self.reader.messages(connections=connections):
            yield self.reader.deserialize(raw, connection.msgtype)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _mirrored(scan: Scan) -> Scan:
    """Return the scan of a laser that is mounted upside down, as the robot sees it."""
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
