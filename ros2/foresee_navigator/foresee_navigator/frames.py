"""Frames: the pose of one frame in another, from /tf where tf2_ros is installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.time import Time

from foresee_navigator.poses import Pose, yaw_of


class FrameError(Exception):
    """The pose of a frame is not known; the message is one line."""


class Frames:
    """Looks up poses of frames.

    Args:
        node: node that listens to /tf.
    """

    def __init__(self, node: Node) -> None:
        self._buffer: Any = None
        try:
            tf2_ros = import_module("tf2_ros")
        except ModuleNotFoundError as error:
            if error.name != "tf2_ros":
                raise
            return
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._failure = tf2_ros.TransformException

    def pose(self, frame: str, outer: str) -> Pose:
        """Return the newest pose of a frame in another frame [m, m, rad].

        Args:
            frame: frame.
            outer: other frame.

        Raises:
            FrameError: if it is not known.
        """
        if frame == outer:
            return 0.0, 0.0, 0.0
        if self._buffer is None:
            raise FrameError(f"frame {frame!r} is not {outer!r}, and tf2_ros is not installed")
        try:
            found = self._buffer.lookup_transform(outer, frame, Time()).transform
        except self._failure as error:
            raise FrameError(f"no transform from {frame!r} to {outer!r}: {error}") from error
        at = found.translation
        return float(at.x), float(at.y), yaw_of(found.rotation)
