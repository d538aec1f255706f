"""The node `foresee_navigator`: drives a robot to goals, or predicts for another planner."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from foresee.mapping.commands import TwistCommand
from foresee.mapping.conventions import TICK
from foresee.mapping.scan import Scan
from foresee_navigator.forecast import Forecaster
from foresee_navigator.frames import FrameError, Frames
from foresee_navigator.messages import diagnostics_message, header_of
from foresee_navigator.parameters import declared
from foresee_navigator.pilot import Action, Mode, Pilot
from foresee_navigator.poses import Motion, Track, composed, motion_of, seconds, yaw_of
from foresee_navigator.prompt_predictor import make_predictor
from foresee_navigator.publishers import MapPublisher, ReinsPublisher
from foresee_navigator.relay import Relay
from foresee_navigator.report import Circumstances, Report, report_on, report_on_forecast
from foresee_navigator.running import run
from foresee_navigator.scans import scan_of, seen_from, without_ranges
from foresee_navigator.settings import NavigatorSettings
from foresee_navigator.warm_up import warm_up
from foresee_navigator.watchdog import Arrival, Watchdog
from planner.guide.search_process import SearchProcess

NAME = "foresee_navigator"
"""Name of the node, and of its diagnostics."""


class NavigatorNode(Node):
    """Turns scans and poses into commands, once a tick."""

    _is_made = False
    """Whether the node has been made; settings that cannot be used end it before."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self._settings = settings = declared(self, NavigatorSettings)
        config, predictor = (
            settings.navigator,
            make_predictor(settings.predictor, settings.deadline),
        )
        self._reins = ReinsPublisher(self, settings)
        self._maps = MapPublisher(self, settings)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._frames = Frames(self)
        self._map_frame = settings.map_frame
        self._early_goal: PoseStamped | None = None
        """Goal that came before the frame of the map was known."""
        took = warm_up(settings, predictor)
        self._searches = SearchProcess()
        self._pilot = Pilot(
            config, predictor, settings.resolution, settings.goal_radius, self._searches
        )
        self._forecaster = Forecaster(config, predictor, settings.resolution)
        self._track = Track(
            config.car,
            settings.timeout,
            settings.leap_distance,
            settings.leap_angle,
            settings.leap_time,
        )
        self._watchdog = Watchdog(("scan", "odometry"), settings.timeout)
        self._scan: LaserScan | None = None
        self._has_read = False
        self._around = Circumstances()
        self._last_message, self._ticked = "", time.monotonic()
        self.create_subscription(LaserScan, "scan", self._take_scan, qos_profile_sensor_data)
        self.create_subscription(Odometry, "odom", self._take_odometry, qos_profile_sensor_data)
        if not settings.predict_only:
            self.create_subscription(PoseStamped, "goal_pose", self._take_goal, 1)
        self.create_timer(TICK, self._tick_on_clock)
        # The node's clock may be that of a simulator, which stops when the simulator ends.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK, self._tick_if_none, clock=steady)
        self.get_logger().info(f"ready: warmed up in {took:.1f} s")
        self._is_made = True

    def destroy_node(self) -> None:
        """Stop the robot, and end the node."""
        if self._is_made:
            self._reins.halt(self.get_clock().now().to_msg())
            self._searches.shutdown()
        super().destroy_node()

    @property
    def _now(self) -> float:
        """Present time on the node's clock [s]."""
        return float(1e-9 * self.get_clock().now().nanoseconds)

    def _take_scan(self, message: LaserScan) -> None:
        self._watchdog.saw("scan", Arrival(time.monotonic(), seconds(message.header.stamp)))
        self._scan, self._has_read = message, False

    def _take_odometry(self, message: Odometry) -> None:
        frame = message.header.frame_id
        self._map_frame = self._map_frame or frame
        if self._early_goal is not None:
            goal, self._early_goal = self._early_goal, None
            self._take_goal(goal)
        try:
            motion = motion_of(message, self._frames.pose(frame, self._map_frame))
        except FrameError as error:
            self.get_logger().error(str(error), throttle_duration_sec=5.0)
            return
        if not motion.is_finite:
            self.get_logger().error("odometry is not finite", throttle_duration_sec=5.0)
            return
        self._watchdog.saw("odometry", Arrival(time.monotonic(), motion.stamp))
        why = self._track.add(motion)
        if why:
            self._begin_anew(why)

    def _take_goal(self, message: PoseStamped) -> None:
        if not self._map_frame:
            # The first odometry tells it.
            self._early_goal = message
            return
        at = message.pose.position
        pose = (float(at.x), float(at.y), yaw_of(message.pose.orientation))
        frame = message.header.frame_id or self._map_frame
        try:
            x, y, _ = composed(self._frames.pose(frame, self._map_frame), pose)
            is_new = self._pilot.head_for((x, y))
        except (FrameError, ValueError) as error:
            self.get_logger().error(f"goal refused: {error}")
            return
        if is_new:
            self.get_logger().info(f"new goal: ({x:.2f}, {y:.2f})")

    def _begin_anew(self, why: str) -> None:
        """Forget the map and what was received, after a leap of the pose or of the clock."""
        self.get_logger().warning(f"{why}: the map begins anew")
        self._pilot.forget()
        self._forecaster.forget()
        self._scan = None
        count = self._around.fresh_starts + 1
        self._around = replace(self._around, fresh_starts=count, last_fresh_start=why)

    def _tick_on_clock(self) -> None:
        """Run a tick of the node's clock."""
        self._tick()
        self._ticked = time.monotonic()

    def _tick_if_none(self) -> None:
        """Run the ticks although the node's clock stands, so that the car brakes to rest."""
        if time.monotonic() - self._ticked > self._settings.timeout:
            self._tick()

    def _tick(self) -> None:
        started, now = time.monotonic(), self._now
        complaints = self._watchdog.complaints(started, now)
        scan, taken, motion = self._scan, None, None
        if not complaints and scan is not None:
            taken = self._track.at(seconds(scan.header.stamp))
            motion = self._track.at(now)
        if not complaints and (taken is None or motion is None):
            complaints = ("no odometry at the time of the scan, or now",)
        self._around = replace(self._around, complaints=complaints)
        self._publish(self._act(scan, taken, motion))

    def _act(self, message: Any, taken: Motion | None, motion: Motion | None) -> Report:
        """Drive or predict; without a motion, stop."""
        started = time.monotonic()
        header = header_of(self.get_clock().now().to_msg(), self._map_frame)
        seen = None
        if taken is not None and motion is not None:
            scan = seen_from(scan_of(message, self._settings.mount), taken.pose, motion.pose)
            seen = motion, without_ranges(scan) if self._has_read else scan
            self._has_read = True
        if self._settings.predict_only:
            forecast = self._forecaster.look(*seen) if seen else None
            self._reins.limit(header.stamp, forecast.speed_limit if forecast else 0.0)
            self._timed(started)
            prediction = forecast.prediction if forecast else None
            self._maps.publish(header, self._forecaster.known, prediction)
            return report_on_forecast(forecast, self._around)
        action = self._decided(*seen) if seen else self._pilot.stop()
        if action.refused:
            self.get_logger().error(f"goal refused: {action.refused}")
        if action.mode is not Mode.LATE:
            self._command(action)
        self._timed(started)
        decision = action.decision
        if decision is not None and decision.path is not None:
            self._reins.path(header, decision.path.points)
        self._maps.publish(header, self._pilot.known, decision.prediction if decision else None)
        return report_on(action, self._around)

    def _decided(self, motion: Motion, scan: Scan) -> Action:
        """Return the pilot's action; what was kept is sent for as long as it is late."""
        state = motion.state
        with Relay(self._command, self._pilot.coming(float(state[3]))) as relay:
            action = self._pilot.act(state, scan)
        return self._pilot.late(relay.sent) if relay.sent else action

    def _command(self, wanted: Action | TwistCommand) -> None:
        self._reins.command(self.get_clock().now().to_msg(), wanted.speed, wanted.yaw_rate)

    def _timed(self, started: float) -> None:
        self._around = replace(self._around, duration=time.monotonic() - started)

    def _publish(self, report: Report) -> None:
        """Publish the report, and log its mode when it changes."""
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics_message(stamp, NAME, report))
        # The numbers change all the time.
        mode = re.sub(r"[\d.]+", "", f"{report.values['mode']} {self._around.complaints}")
        if mode != self._last_message:
            self._last_message = mode
            self.get_logger().info(report.message)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run(NavigatorNode, args)


if __name__ == "__main__":
    main()
