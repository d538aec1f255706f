"""The node `foresee_simulator`: a simulated robot with a LIDAR, odometry and a goal."""

from __future__ import annotations

import array
import time
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import LaserScan

from foresee_navigator.messages import (
    diagnostics_message,
    header_of,
    optional,
    pose_at,
    transforms_message,
)
from foresee_navigator.parameters import declared
from foresee_navigator.report import Report, Severity
from foresee_navigator.running import run
from foresee_navigator.settings import SimulatorSettings
from foresee_navigator.simulated_robot import STEP, SimulatedRobot, due, fields_of, task_for

NAME = "foresee_simulator"
"""Name of the node, and of its diagnostics."""
LONGEST_LAG = 0.5
"""Time by which the simulation may be late before it lets the rest go [s]."""


class SimulatorNode(Node):
    """Moves the simulated robot in real time, or at another speed with a clock of its own."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self._settings = settings = declared(self, SimulatorSettings)
        self._task = task_for(settings)
        self._robot = SimulatedRobot(settings, self._task)
        # Compile before the clock starts.
        self._robot.scan()
        self._scans = self.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._odometry = self.create_publisher(Odometry, "odom", 10)
        self._goals = self.create_publisher(PoseStamped, "goal_pose", 1)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        if settings.clock:
            self._clocks = self.create_publisher(ClockMessage, "/clock", 10)
        self.create_subscription(Twist, "cmd_vel", self._take_command, 1)
        self._outcome, self._has_set_off = "", False
        self._begun = time.monotonic()
        # Stamps without a clock of its own count from here [ns].
        self._epoch = 0 if settings.clock else time.time_ns()
        self.create_timer(STEP, self._advance, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._transforms: Any = None
        if optional("tf2_msgs", "TFMessage"):
            self._transforms = self.create_publisher(optional("tf2_msgs", "TFMessage"), "/tf", 10)
        x, y = self._task.goal
        self.get_logger().info(
            f"ready: {self._task.world.name}, {self._task.path_length:.0f} m to the goal "
            f"({x:.2f}, {y:.2f})"
        )

    def _take_command(self, message: Twist) -> None:
        try:
            speed, yaw_rate = float(message.linear.x), float(message.angular.z)
            self._robot.command(speed, yaw_rate)
            self._has_set_off |= bool(speed or yaw_rate)
        except ValueError as error:
            self.get_logger().error(str(error), throttle_duration_sec=5.0)

    def _advance(self) -> None:
        """Move the robot up to the present time."""
        speed = self._settings.speed_of_time
        behind = speed * (time.monotonic() - self._begun) - self._robot.time
        if behind > LONGEST_LAG and not self._settings.clock:
            # The machine was too busy: time passes without the robot, as in a pause.
            self._epoch += round(1e9 * behind)
        if behind > LONGEST_LAG:
            self._begun += behind / speed
            behind = STEP
        for _ in range(int(behind / STEP)):
            self._robot.step()
            self._publish()

    @property
    def _stamp(self) -> Time:
        nanoseconds = self._epoch + round(1e9 * self._robot.time)
        return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def _publish(self) -> None:
        settings, now = self._settings, self._robot.time
        stamp = self._stamp
        if settings.clock:
            self._clocks.publish(ClockMessage(clock=stamp))
        if due(now, settings.odometry_period):
            self._publish_odometry(stamp)
        if due(now, settings.scan_period):
            self._publish_scan(stamp)
        self._has_set_off &= self._robot.is_commanded
        if due(now, 1.0) and not self._has_set_off:
            # Other goals may follow it on the drive.
            header = header_of(stamp, settings.odometry_frame)
            pose = pose_at(*self._task.goal, 0.0)
            self._goals.publish(PoseStamped(header=header, pose=pose))
        if due(now, 0.2):
            self._report(stamp)

    def _publish_odometry(self, stamp: Time) -> None:
        settings = self._settings
        x, y, yaw, speed = map(float, self._robot.state)
        message = Odometry(header=header_of(stamp, settings.odometry_frame))
        message.child_frame_id = settings.base_frame
        message.pose.pose = pose_at(x, y, yaw)
        message.twist.twist.linear.x = speed
        message.twist.twist.angular.z = self._robot.yaw_rate
        self._odometry.publish(message)
        if self._transforms is not None:
            frames = settings.odometry_frame, settings.base_frame, settings.scan_frame
            poses = (x, y, yaw), settings.mount
            self._transforms.publish(transforms_message(stamp, frames, poses))

    def _publish_scan(self, stamp: Time) -> None:
        scan = self._robot.scan()
        message = LaserScan(header=header_of(stamp, self._settings.scan_frame))
        for name, value in fields_of(scan).items():
            setattr(message, name, value)
        message.ranges = array.array("f", scan.ranges.astype(np.float32).tobytes())
        self._scans.publish(message)

    def _report(self, stamp: Time) -> None:
        """Publish what became of the drive, and log it once."""
        robot = self._robot
        if robot.has_collided:
            severity, message = Severity.ERROR, "collided"
        elif robot.has_reached:
            severity, message = Severity.OK, "reached the goal"
        else:
            severity, message = Severity.OK, "on the way"
        if message != self._outcome:
            self._outcome = message
            self.get_logger().info(f"{message} after {robot.time:.1f} s")
        values = {
            "time": f"{robot.time:.2f}",
            "to_goal": f"{robot.to_goal:.2f}",
            "speed": f"{robot.state[3]:.2f}",
        }
        report = Report(severity, message, values)
        self._diagnostics.publish(diagnostics_message(stamp, NAME, report))


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(SimulatorNode, args)


if __name__ == "__main__":
    main()
