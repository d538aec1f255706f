"""Publishers of the navigator: what moves the robot, and the maps."""

from __future__ import annotations

import time

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Path
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

from foresee.mapping.grid import OccupancyGrid
from foresee.prediction import Prediction
from foresee_navigator.maps import observed_values, predicted_values
from foresee_navigator.messages import (
    command_message,
    command_type,
    grid_message,
    header_of,
    limit_message,
    limit_type,
    path_message,
)
from foresee_navigator.settings import NavigatorSettings


class ReinsPublisher:
    """Publishes the command and the path, or the speed limit for another planner.

    Args:
        node: node that publishes.
        settings: settings of the node.

    Raises:
        ValueError: if the command needs a package that is not installed.
    """

    def __init__(self, node: Node, settings: NavigatorSettings) -> None:
        self._settings = settings
        if settings.predict_only:
            self._limit_type = limit_type()
            self._limit = node.create_publisher(self._limit_type, "speed_limit", 1)
        else:
            self._command_type = command_type(settings.command)
            topic = "ackermann_cmd" if settings.command == "ackermann" else "cmd_vel"
            self._command = node.create_publisher(self._command_type, topic, 1)
            self._path = node.create_publisher(Path, "path", 1)

    def command(self, stamp: Time, speed: float, yaw_rate: float) -> None:
        """Publish a command: speed [m/s], negative in reverse, and yaw rate [rad/s]."""
        header = header_of(stamp, self._settings.base_frame)
        wheelbase = self._settings.wheelbase
        message = command_message(self._command_type, header, speed, yaw_rate, wheelbase)
        self._command.publish(message)

    def limit(self, stamp: Time, limit: float) -> None:
        """Publish a speed limit [m/s]."""
        header = header_of(stamp, self._settings.base_frame)
        self._limit.publish(limit_message(self._limit_type, header, limit))

    def halt(self, stamp: Time) -> None:
        """Publish that the robot is to stand."""
        if self._settings.predict_only:
            self.limit(stamp, 0.0)
        else:
            self.command(stamp, 0.0, 0.0)

    def path(self, header: Header, points: NDArray[np.float64]) -> None:
        """Publish a path through points, (n, 2) [m]."""
        self._path.publish(path_message(header, points))


class MapPublisher:
    """Publishes the observed and the predicted map, once a period.

    A subscriber that comes later gets the last one, as the static layer of Nav2 expects.

    Args:
        node: node that publishes.
        settings: settings of the node.
    """

    def __init__(self, node: Node, settings: NavigatorSettings) -> None:
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._observed = node.create_publisher(GridMessage, "observed_map", kept)
        self._predicted = node.create_publisher(GridMessage, "predicted_map", kept)
        self._settings, self._next = settings, 0.0

    def publish(
        self, header: Header, known: OccupancyGrid | None, prediction: Prediction | None
    ) -> None:
        """Publish the maps that there are, if it is time.

        Args:
            header: stamp, and the frame of the maps.
            known: observed map, or None.
            prediction: prediction, or None.
        """
        if known is None or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + self._settings.map_period
        observed = observed_values(known.log_odds)
        self._observed.publish(grid_message(header, known.frame, observed))
        if prediction is not None:
            predicted = predicted_values(prediction, self._settings.confidence)
            self._predicted.publish(grid_message(header, prediction.frame, predicted))
