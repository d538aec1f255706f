"""Messages of the nodes, with stand-ins for packages that have no wheels."""

import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install -e '.[ros2]'")

from builtin_interfaces.msg import Time
from foresee_navigator.frames import FrameError, Frames
from foresee_navigator.messages import (
    command_message,
    command_type,
    diagnostics_message,
    grid_message,
    header_of,
    limit_message,
    limit_type,
    path_message,
    transforms_message,
)
from foresee_navigator.poses import quaternion_of, yaw_of
from foresee_navigator.report import Report, Severity

from foresee.mapping.grid import GridFrame

HEADER = header_of(Time(sec=3), "base_link")


@pytest.fixture
def stand_in(monkeypatch):
    """Installs a package that has a module `msg` with one type."""

    def install(package, name, make):
        module, messages = ModuleType(package), ModuleType(f"{package}.msg")
        setattr(messages, name, make)
        monkeypatch.setitem(sys.modules, package, module)
        monkeypatch.setitem(sys.modules, f"{package}.msg", messages)

    return install


@pytest.mark.parametrize("command", ["twist", "twist_stamped"])
def test_a_twist_has_the_speed_and_the_yaw_rate(command):
    message = command_message(command_type(command), HEADER, -0.5, 0.25, 0.3)
    twist = message.twist if command == "twist_stamped" else message
    assert (twist.linear.x, twist.angular.z) == (-0.5, 0.25)


def test_ackermann_is_refused_without_its_package():
    with pytest.raises(ValueError, match="ackermann_msgs is not installed"):
        command_type("ackermann")


def test_an_ackermann_command_steers_on_the_curvature_in_both_gears(stand_in):
    make = lambda: SimpleNamespace(drive=SimpleNamespace())  # noqa: E731
    stand_in("ackermann_msgs", "AckermannDriveStamped", make)
    kind = command_type("ackermann")
    for speed in (2.0, -2.0):
        message = command_message(kind, HEADER, speed, speed * 0.5, 0.3)
        assert message.drive.speed == speed
        assert message.drive.steering_angle == pytest.approx(math.atan(0.15))
        assert message.header is HEADER


def test_a_limit_is_a_number_or_that_of_nav2_where_0_would_be_no_limit(stand_in):
    assert limit_message(limit_type(), HEADER, 0.0).data == 0.0
    stand_in("nav2_msgs", "SpeedLimit", SimpleNamespace)
    message = limit_message(limit_type(), HEADER, 0.0)
    assert not message.percentage
    assert message.speed_limit == 0.01
    assert limit_message(limit_type(), HEADER, 1.5).speed_limit == 1.5


def test_a_map_lies_row_by_row_at_its_origin():
    frame = GridFrame(0.05, (-1.0, 2.0), (2, 3))
    message = grid_message(HEADER, frame, np.array([[0, 1, 2], [-1, 50, 100]], np.int8))
    assert list(message.data) == [0, 1, 2, -1, 50, 100]
    assert (message.info.width, message.info.height) == (3, 2)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-1.0, 2.0)


def test_the_poses_of_a_path_look_along_it():
    message = path_message(HEADER, np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]))
    yaws = [yaw_of(stamped.pose.orientation) for stamped in message.poses]
    assert yaws == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert len(path_message(HEADER, np.array([[0.0, 0.0]])).poses) == 1


def test_a_report_becomes_a_status():
    message = diagnostics_message(Time(), "node", Report(Severity.WARN, "late", {"late": "yes"}))
    (status,) = message.status
    assert (status.level, status.name, status.message) == (b"\x01", "node", "late")
    assert [(pair.key, pair.value) for pair in status.values] == [("late", "yes")]


def test_transforms_lead_from_frame_to_frame(stand_in):
    stand_in("tf2_msgs", "TFMessage", lambda: SimpleNamespace(transforms=[]))
    poses = (1.0, 2.0, 0.5), (0.1, 0.0, 0.0)
    message = transforms_message(Time(), ("odom", "base", "laser"), poses)
    names = [(t.header.frame_id, t.child_frame_id) for t in message.transforms]
    assert names == [("odom", "base"), ("base", "laser")]
    assert yaw_of(message.transforms[0].transform.rotation) == pytest.approx(0.5)


def test_without_tf2_a_frame_is_known_only_in_itself():
    frames = Frames(None)
    assert frames.pose("odom", "odom") == (0.0, 0.0, 0.0)
    with pytest.raises(FrameError, match="tf2_ros is not installed"):
        frames.pose("odom", "map")


def test_with_tf2_a_pose_is_the_newest_transform(monkeypatch):
    class Failure(Exception):
        pass

    class Buffer:
        def lookup_transform(self, outer, frame, _):
            if outer != "map":
                raise Failure("no such frame")
            rotation = SimpleNamespace(**dict(zip("xyzw", quaternion_of(0.5), strict=True)))
            at = SimpleNamespace(x=1.0, y=2.0)
            return SimpleNamespace(transform=SimpleNamespace(translation=at, rotation=rotation))

    module = ModuleType("tf2_ros")
    module.Buffer, module.TransformException = Buffer, Failure
    module.TransformListener = lambda buffer, node: None
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    frames = Frames(None)
    assert frames.pose("odom", "map") == pytest.approx((1.0, 2.0, 0.5))
    with pytest.raises(FrameError, match="no transform from 'odom' to 'nowhere'"):
        frames.pose("odom", "nowhere")
