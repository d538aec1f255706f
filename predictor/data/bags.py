"""Bags of ROS 1 and ROS 2, read without ROS by the package rosbags (the extra `bags`).

Scans are sensor_msgs/LaserScan. The pose of a scan comes from /tf, if that connects the map frame
with each laser; else from a topic of geometry_msgs/PoseStamped, PoseWithCovarianceStamped or
nav_msgs/Odometry, which gives the pose of the robot, the frame that /tf_static fixes the laser to.
Poses are interpolated at the times of the scans. Scans before the first pose, after the last, or in
a gap of more than a second are skipped and counted, as are scans without beams and transforms with
NaN. Where the stamps of a topic are all the same, the times of the bag are used instead. All beams
of a scan get the same pose: the motion of the robot during a scan is ignored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foresee.infra.input_file import check_input, read_input
from foresee.infra.plain_yaml import read_yaml
from foresee.mapping.scan import Scan
from predictor.data import BAGS, PACKED
from predictor.data.bag_config import BagConfig
from predictor.data.laser_log import LaserLog, LogError, cleaned
from predictor.data.transforms import Transforms

SCAN = "sensor_msgs/msg/LaserScan"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
)
STATIC = "tf_static"
"""Last part of the name of a topic of fixed transforms."""
POSED = "(pose topic)"
"""Name used here for the frame in which the poses of a pose topic are given."""
METADATA = "metadata.yaml"
MAX_METADATA = 1_000_000
"""Largest metadata file of a ROS 2 bag that is read [bytes]."""
LARGEST_BAG = 2**40
"""Largest file of a bag that is read [bytes]."""
LEVEL = math.cos(math.radians(10.0))
"""Cosine of the largest tilt at which a laser counts as level."""


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a file with such an ending, or the folder of a ROS 2 bag.

    The file may be compressed, see `read_bag`.
    """
    name = path.with_suffix("") if path.suffix in PACKED else path
    return name.suffix in BAGS or (path / METADATA).is_file()


def read_bag(path: Path, config: BagConfig | None = None) -> LaserLog:
    """Read all scans of a bag that have a pose.

    Args:
        path: path of the file, or of a ROS 2 bag's folder, which is also read instead of a file
            in it that ROS 2 has compressed.
        config: topics to read.

    Raises:
        LogError: if rosbags is not installed, the bag cannot be read, it has no scans or no poses,
            or several topics of them and `config` names none.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError("bags are read by rosbags: pip install 'foresee-nav[bags]'") from None
    if not path.exists():
        raise LogError(f"{path}: no such file")
    if path.suffix in PACKED and path.is_file():
        # ROS 2 compresses the files of a bag; its folder says how.
        beside = path.parent / METADATA
        if not beside.is_file() or path.name not in _text(beside):
            raise LogError(f"{path} is a compressed bag: unpack it, or give a ROS 2 bag's folder")
        path = path.parent
    described = path / METADATA
    try:
        for file in _files(path):
            check_input(file, LARGEST_BAG)
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


def _text(metadata: Path) -> str:
    """Return the text of a metadata file; "" if it cannot be read."""
    try:
        return read_input(metadata, MAX_METADATA).decode(errors="replace")
    except (OSError, ValueError):
        return ""


def _files(path: Path) -> list[Path]:
    """Return the files of a bag: its only one, or all of its folder."""
    return [file for file in path.iterdir() if not file.is_dir()] if path.is_dir() else [path]


class _Bag:
    """An open bag."""

    def __init__(self, path: Path, reader: Any, config: BagConfig) -> None:
        self.path, self.reader, self.config = path, reader, config
        self.kinds = {c.topic: c.msgtype for c in reader.connections}
        self.notes: list[str] = []

    def log(self) -> LaserLog:
        topic = self._chosen(self.config.scans, (SCAN,), "scans", "--scans")
        scans = self._scans(topic)
        lasers = sorted(set(scans.frames))
        transforms = self._transforms(topic)
        root = self._source(transforms, lasers)
        times = scans.times
        positions, rotations = np.zeros((len(times), 3)), np.zeros((len(times), 3, 3))
        known = ~scans.repeated
        for laser in lasers:
            of_it = np.array([frame == laser for frame in scans.frames])
            try:
                positions[of_it], turns, inside = transforms.look_up(root, laser, times[of_it])
            except KeyError:
                raise LogError(
                    f"{self.path}: nothing leads from {root!r} to the laser's frame {laser!r}"
                ) from None
            rotations[of_it] = turns.as_matrix()
            known[of_it] &= inside
        if not known.any():
            raise LogError(
                f"{self.path}: no scan was taken within a second of two poses; the scans are of "
                f"{times.min():.3f} to {times.max():.3f} s"
            )
        if (abs(rotations[known, 2, 2]) < LEVEL).any():
            raise LogError(f"{self.path}: the laser leans by more than 10°; level ones are read")
        yaw = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
        poses = np.column_stack([positions[:, :2], yaw])
        order = np.argsort(times, kind="stable")
        order = order[known[order]]
        upright = rotations[:, 2, 2] > 0
        kept = [scans.scans[i] if upright[i] else _mirrored(scans.scans[i]) for i in order]
        skipped = {
            "bad ranges": scans.bad_ranges,
            "bad scans": scans.bad,
            "bad transforms": transforms.bad,
            "scans that repeat a time": int(scans.repeated.sum()),
            "scans without a pose": int((~known & ~scans.repeated).sum()),
        }
        name = self.path.name.removesuffix(self.path.suffix)
        notes = tuple(self.notes)
        return LaserLog(name, tuple(kept), poses[order], times[order], skipped, notes)

    def _scans(self, topic: str) -> _Scans:
        """Read the scans of a topic; those that cannot be used are counted.

        Raises:
            LogError: if there is none, or none that can be used; the message says why.
        """
        scans, stamps, received, frames = list[Scan](), list[float](), list[float](), list[str]()
        bad_ranges, reasons = 0, list[str]()
        for message, time in self._messages(topic):
            ranges = np.asarray(message.ranges, dtype=np.float64)
            beams = float(message.angle_min), float(message.angle_increment)
            if not message.range_max > 0:
                reasons.append(f"gives a range_max of {message.range_max} m")
            elif not np.isfinite(beams).all() or beams[1] == 0.0:
                reasons.append(f"has beams from {beams[0]} rad on, {beams[1]} rad apart")
            elif len(ranges) == 0:
                reasons.append("has scans without ranges")
            else:
                ranges, wrong = cleaned(ranges, float(message.range_min))
                bad_ranges += wrong
                scans.append(Scan(ranges, *beams, float(message.range_max)))
                stamps.append(_seconds(message.header.stamp))
                received.append(time)
                frames.append(message.header.frame_id.lstrip("/"))
        if not scans:
            why = f"{topic} {reasons[0]}" if reasons else f"{topic} holds no scan"
            raise LogError(f"{self.path}: {why}")
        times = self._clock(topic, stamps, received)
        return _Scans(scans, times, frames, bad_ranges, len(reasons))

    def _transforms(self, scans: str) -> Transforms:
        """Read the transforms, of the namespace of the topic of the scans if there are several."""
        transforms = Transforms()
        for topic in self._tf_topics(scans):
            entries = [
                (entry, time)
                for message, time in self._messages(topic)
                for entry in message.transforms
            ]
            fixed = topic.rpartition("/")[2] == STATIC
            stamps = [_seconds(entry.header.stamp) for entry, _ in entries]
            times = stamps if fixed else self._clock(topic, stamps, [time for _, time in entries])
            for (entry, _), time in zip(entries, times, strict=True):
                where, turn = entry.transform.translation, entry.transform.rotation
                transforms.add(
                    entry.header.frame_id.lstrip("/"),
                    entry.child_frame_id.lstrip("/"),
                    time,
                    (where.x, where.y, where.z),
                    (turn.x, turn.y, turn.z, turn.w),
                    fixed=fixed,
                )
        return transforms

    def _tf_topics(self, scans: str) -> list[str]:
        """Return the topics of transforms that belong to a topic of scans.

        Raises:
            LogError: if there are several namespaces, and the scans are in none of them.
        """
        topics = [topic for topic, kind in self.kinds.items() if kind in TRANSFORMS]
        spaces = {topic: topic.rpartition("/")[0] + "/" for topic in topics}
        if len(set(spaces.values())) > 1:
            topics = [topic for topic in topics if scans.startswith(spaces[topic])]
            if not topics:
                raise LogError(
                    f"{self.path}: its transforms are of several robots, {', '.join(spaces)}, and "
                    f"{scans} does not say which of them it belongs to"
                )
        return topics

    def _clock(self, topic: str, stamps: list[float], received: list[float]) -> NDArray[np.float64]:
        """Return the times of messages [s]: their stamps, unless all of them are the same.

        Args:
            topic: topic of the messages.
            stamps: stamp of each message [s].
            received: time at which the bag received it [s].
        """
        frozen = len(set(stamps)) == 1 and len(set(received)) > 1
        if not frozen and any(stamps):
            return np.array(stamps)
        if stamps:
            self.notes.append(
                f"the stamps of {topic} are all {stamps[0]:g} s: the times at which the bag "
                "received the messages are used"
            )
        return np.array(received)

    def _source(self, transforms: Transforms, lasers: list[str]) -> str:
        """Return the frame that poses are given in, and add the poses of a pose topic."""
        root, wanted = self.config.map_frame, self.config.poses
        ancestors = [transforms.paths(laser) for laser in lasers]
        by_transforms = all(root in paths for paths in ancestors)
        if wanted is None and by_transforms:
            return root
        no_topic = wanted is None and not any(kind in POSES for kind in self.kinds.values())
        if self.kinds.get(wanted or "") in TRANSFORMS or (no_topic and transforms.edges):
            if not by_transforms:
                raise LogError(f"{self.path}: {self._unconnected(transforms, lasers)}")
            return root
        if wanted is None and not by_transforms and root != BagConfig().map_frame:
            raise LogError(f"{self.path}: {self._unconnected(transforms, lasers)}")
        topic = self._chosen(wanted, POSES, "poses", "--poses")
        robots = sorted({transforms.carrier(laser) for laser in lasers})
        if len(robots) > 1:
            raise LogError(
                f"{self.path}: the scans are of several frames, {', '.join(lasers)}, and no "
                "transform fixes them to one robot"
            )
        if robots[0] in lasers:
            self.notes.append(
                f"no static transform says where laser {robots[0]!r} is on the robot: the poses "
                f"of {topic} are taken as the laser's own"
            )
        # The pose topic replaces what /tf says about the robot.
        transforms.edges.pop(robots[0], None)
        messages = list(self._messages(topic))
        stamps = [_seconds(message.header.stamp) for message, _ in messages]
        times = self._clock(topic, stamps, [time for _, time in messages])
        for (message, _), time in zip(messages, times, strict=True):
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
            at, turn = pose.position, pose.orientation
            transforms.add(
                POSED, robots[0], time, (at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w)
            )
        return POSED

    def _unconnected(self, transforms: Transforms, lasers: list[str]) -> str:
        """Return why the map frame is no ancestor of a laser's frame."""
        root = self.config.map_frame
        laser = next(laser for laser in lasers if root not in transforms.paths(laser))
        above = list(transforms.paths(laser))[1:]
        if above:
            return (
                f"the transforms lead from the laser to {', '.join(above)}, not to {root!r}; "
                "--map-frame says where to"
            )
        static = any(topic.rpartition("/")[2] == STATIC for topic in self.kinds)
        lacking = "" if static else ", and the bag has no /tf_static"
        return (
            f"nothing connects the scans' frame {laser!r} with the frames of the transforms "
            f"({', '.join(transforms.frames)}){lacking}"
        )

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
                f"choose one by {flag}"
            )
        return fitting[0]

    def _messages(self, topic: str) -> Iterator[tuple[Any, float]]:
        """Yield the messages of a topic, each with the time at which the bag received it [s]."""
        connections = [c for c in self.reader.connections if c.topic == topic]
        for connection, received, raw in self.reader.messages(connections=connections):
            yield self.reader.deserialize(raw, connection.msgtype), 1e-9 * received


@dataclass(frozen=True, eq=False)
class _Scans:
    """The scans of a topic that can be used.

    Attributes:
        scans: scans in the order of the bag.
        times: time of each [s].
        frames: frame of the laser of each.
        bad_ranges: number of ranges that are NaN or negative.
        bad: number of scans that were left out.
    """

    scans: list[Scan]
    times: NDArray[np.float64]
    frames: list[str]
    bad_ranges: int
    bad: int

    @cached_property
    def repeated(self) -> NDArray[np.bool_]:
        """Whether an earlier scan of the same laser has the same time, (n,).

        The clock of such a laser has stopped, so the pose at that time is not the scan's.
        """
        seen, repeated = set[tuple[str, float]](), np.zeros(len(self.frames), dtype=bool)
        for i, key in enumerate(zip(self.frames, self.times.tolist(), strict=True)):
            repeated[i] = key in seen
            seen.add(key)
        return repeated


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _mirrored(scan: Scan) -> Scan:
    """Return the scan of a laser that is mounted upside down, as the robot sees it."""
    return replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
