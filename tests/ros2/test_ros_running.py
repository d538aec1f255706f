"""A node ends when it is asked to, whatever it does at that moment."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install -e '.[ros2]'")

CODE = """
import os
import signal

from foresee_navigator.running import run
from rclpy.node import Node


class Stubborn(Node):
    def __init__(self):
        super().__init__("stubborn")
        self.create_timer(0.01, self.tick)

    def tick(self):
        try:
            os.kill(os.getpid(), signal.{name})
            print("the tick ended")
        except BaseException:
            print("it was interrupted")

    def destroy_node(self):
        print("and the node")
        super().destroy_node()


run(Stubborn, [])
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_in_a_tick_ends_the_node_after_it(name, tmp_path):
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path),
    }
    done = subprocess.run(
        [sys.executable, "-c", CODE.format(name=name)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == ["the tick ended", "and the node"]


@pytest.mark.parametrize(
    ("given", "message"), [("v_max:=-1.0", "v_max"), ("predictor:=nope", "no predictor is named")]
)
def test_a_parameter_that_cannot_be_used_is_told_in_a_line(given, message, tmp_path):
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path),
    }
    node = [sys.executable, "-m", "foresee_navigator.navigator_node"]
    done = subprocess.run(
        [*node, "--ros-args", "-p", given],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert message in line
