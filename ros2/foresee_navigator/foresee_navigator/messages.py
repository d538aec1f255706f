"""ROS messages of what the nodes say, with those that not every installation has."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseStamped, TransformStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray
from std_msgs.msg import Float64, Header

from foresee.mapping.grid import GridFrame
from foresee_navigator.poses import Pose as PlanarPose
from foresee_navigator.poses import quaternion_of
from foresee_navigator.report import Report

CREEP = 0.01
"""Speed limit of nav2_msgs/SpeedLimit that stands for 0 [m/s], where 0 means that there is none."""


def optional(package: str, name: str) -> Any:
    """Return a message type of a package that may not be installed, or None."""
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        return None


def command_type(command: str) -> Any:
    """Return the message type of a command: twist, twist_stamped or ackermann.

    Raises:
        ValueError: if its package is not installed.
    """
    if command == "ackermann":
        kind = optional("ackermann_msgs", "AckermannDriveStamped")
        if kind is None:
            raise ValueError("command is ackermann, but ackermann_msgs is not installed")
        return kind
    return {"twist": Twist, "twist_stamped": TwistStamped}[command]


def command_message(
    kind: Any, header: Header, speed: float, yaw_rate: float, wheelbase: float
) -> Any:
    """Return the message of a command.

    Args:
        kind: message type.
        header: stamp, and the frame of the robot.
        speed: speed, negative in reverse [m/s].
        yaw_rate: yaw rate [rad/s].
        wheelbase: distance between the axles [m].
    """
    message = kind()
    if kind is Twist or kind is TwistStamped:
        twist = message if kind is Twist else message.twist
        twist.linear.x, twist.angular.z = speed, yaw_rate
    else:
        message.drive.speed = speed
        curvature = yaw_rate / speed if speed != 0.0 else 0.0
        message.drive.steering_angle = math.atan(wheelbase * curvature)
    if kind is not Twist:
        message.header = header
    return message


def limit_type() -> Any:
    """Return the message type of a speed limit: nav2_msgs/SpeedLimit, or else Float64."""
    return optional("nav2_msgs", "SpeedLimit") or Float64


def limit_message(kind: Any, header: Header, limit: float) -> Any:
    """Return the message of a speed limit [m/s]."""
    message = kind()
    if kind is Float64:
        message.data = limit
    else:
        message.header, message.percentage = header, False
        message.speed_limit = max(limit, CREEP)
    return message


def header_of(stamp: Time, frame: str) -> Header:
    """Return a header."""
    return Header(stamp=stamp, frame_id=frame)


def pose_at(x: float, y: float, yaw: float) -> Pose:
    """Return a pose in the plane [m, m, rad]."""
    pose = Pose()
    pose.position.x, pose.position.y = float(x), float(y)
    turn = pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion_of(yaw)
    return pose


def transforms_message(stamp: Time, frames: Sequence[str], poses: Sequence[PlanarPose]) -> Any:
    """Return the tf2_msgs/TFMessage of a chain of frames.

    Args:
        stamp: stamp.
        frames: names of the n frames, the outermost first.
        poses: pose of each frame but the first in the one before it, n - 1.
    """
    message = optional("tf2_msgs", "TFMessage")()
    for outer, frame, (x, y, yaw) in zip(frames, frames[1:], poses, strict=False):
        transform = TransformStamped(header=header_of(stamp, outer), child_frame_id=frame)
        transform.transform.translation.x, transform.transform.translation.y = x, y
        transform.transform.rotation = pose_at(x, y, yaw).orientation
        message.transforms.append(transform)
    return message


def path_message(header: Header, points: NDArray[np.float64]) -> Path:
    """Return the message of a path through points, (n, 2) [m]."""
    steps = np.diff(points, axis=0)
    yaws = np.arctan2(steps[:, 1], steps[:, 0]) if len(steps) else np.zeros(1)
    yaws = np.append(yaws, yaws[-1])[: len(points)]
    poses = [
        PoseStamped(header=header, pose=pose_at(x, y, float(yaw)))
        for (x, y), yaw in zip(points, yaws, strict=True)
    ]
    return Path(header=header, poses=poses)


def grid_message(header: Header, frame: GridFrame, values: NDArray[np.int8]) -> OccupancyGrid:
    """Return the message of a map.

    Args:
        header: stamp, and the frame of the map.
        frame: position and resolution of the cells.
        values: value of each cell, (rows, columns).
    """
    message = OccupancyGrid(header=header)
    message.info.map_load_time = header.stamp
    message.info.resolution = frame.resolution
    message.info.height, message.info.width = frame.shape
    message.info.origin = pose_at(*frame.origin, 0.0)
    message.data = array.array("b", np.ascontiguousarray(values).tobytes())
    return message


def diagnostics_message(stamp: Time, name: str, report: Report) -> DiagnosticArray:
    """Return the message of a report of a node."""
    status = DiagnosticStatus(
        level=bytes([report.severity]),
        name=name,
        message=report.message,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )
    return DiagnosticArray(header=header_of(stamp, ""), status=[status])
