"""A stage for the ROS nodes: processes over DDS, and a node between robot and navigator."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from contextlib import contextmanager, suppress
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

ROOT = Path(__file__).parents[2]
PATIENCE = 240.0
"""Longest wait for anything [s]; the first start of the navigator compiles."""


class Stage:
    """Relays scans and odometry to the navigator, and listens to both nodes.

    Attributes:
        scans_to_drop: number of the next scans that are not relayed.
        delay: time by which odometry is held back [s].
        times_back: number of times that the stamps of the odometry went back.
    """

    def __init__(self, log):
        domain = 1 + os.getpid() % 100
        self.environment = os.environ | {
            "PYTHONPATH": f"{ROOT}:{ROOT / 'ros2/foresee_navigator'}",
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(log.parent),
        }
        os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        self._log = log
        self.scans_to_drop, self.delay, self._held = 0, 0.0, deque()
        self.times_back = 0
        self.latest, self.reports, self.outcomes = {}, [], []
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node("stage", context=self._context)
        self._scans = self.node.create_publisher(LaserScan, "relayed/scan", qos_profile_sensor_data)
        self._odometry = self.node.create_publisher(Odometry, "relayed/odom", 10)
        listen = self.node.create_subscription
        listen(LaserScan, "scan", self._relay_scan, qos_profile_sensor_data)
        listen(Odometry, "odom", self._relay_odometry, 10)
        listen(DiagnosticArray, "/diagnostics", self._take_report, 10)
        for kind, topic in (
            (Twist, "cmd_vel"),
            (PathMessage, "path"),
            (OccupancyGrid, "observed_map"),
            (OccupancyGrid, "predicted_map"),
        ):
            listen(
                kind, topic, lambda message, topic=topic: self.latest.update({topic: message}), 1
            )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self):
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self):
        self._executor.shutdown()
        rclpy.shutdown(context=self._context)
        self._thread.join()

    def _relay_scan(self, message):
        if self.scans_to_drop > 0:
            self.scans_to_drop -= 1
        else:
            self._scans.publish(message)

    def _relay_odometry(self, message):
        if "odom" in self.latest and self.seconds > message.header.stamp.sec + 1:
            self.times_back += 1
        self.latest["odom"] = message
        self._held.append((time.monotonic() + self.delay, message))
        while self._held and (self.delay == 0.0 or self._held[0][0] <= time.monotonic()):
            self._odometry.publish(self._held.popleft()[1])

    def _take_report(self, message):
        for status in message.status:
            if status.name == "foresee_navigator":
                values = {pair.key: pair.value for pair in status.values}
                self.reports.append((ord(status.level), status.message, values))
            else:
                self.outcomes.append(status.message)

    @contextmanager
    def process(self, module, *words):
        """Run a node in a process of its own."""
        command = [sys.executable, "-m", f"foresee_navigator.{module}", "--ros-args", *words]
        with self._log.open("a") as log:
            process = subprocess.Popen(
                command, env=self.environment, stdout=log, stderr=subprocess.STDOUT
            )
            try:
                yield process
            finally:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
                try:
                    process.wait(20.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def wait_for(self, condition, what, patience=PATIENCE):
        """Wait until a condition holds, for some seconds at most."""
        end = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < end, f"{what}; log:\n{self._log.read_text()}"
            time.sleep(0.02)

    def wait_for_report(self, matches, what):
        """Wait for a report of the navigator that is yet to come, and return it."""
        seen = len(self.reports)
        self.wait_for(lambda: any(map(matches, self.reports[seen:])), what)
        return next(report for report in self.reports[seen:] if matches(report))

    @property
    def seconds(self):
        """Whole seconds of the simulator's clock."""
        return self.latest["odom"].header.stamp.sec

    @property
    def speed(self):
        """Speed of the simulated robot [m/s]."""
        return self.latest["odom"].twist.twist.linear.x

    @property
    def command(self):
        """Newest command: speed [m/s] and yaw rate [rad/s]."""
        twist = self.latest["cmd_vel"]
        return twist.linear.x, twist.angular.z
