"""Bags of ROS 1 and ROS 2, written for tests."""

import math

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

LASER_AT = (0.3, 0.1, 0.2)
"""Where the laser sits on the robot: x, y [m], and its height."""
TURN = 0.25
"""Of the laser on the robot [rad]."""


def turn(yaw, roll=0.0):
    """A quaternion x, y, z, w: rolled, then turned."""
    a, b = 0.5 * yaw, 0.5 * roll
    return (
        math.cos(a) * math.sin(b),
        math.sin(a) * math.sin(b),
        math.sin(a) * math.cos(b),
        math.cos(a) * math.cos(b),
    )


class Bag:
    """Writes a bag of one of the two kinds."""

    def __init__(self, path, ros):
        self.ros, self.path = ros, path
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        if ros == 1:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self.writer = rosbag1.Writer(path) if ros == 1 else rosbag2.Writer(path, version=9)
        self.topics = {}
        self.stopped = None
        """Time at which the clock of the messages stands [s]; None: it runs."""

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def make(self, kind, *values):
        return self.store.types[kind](*values)

    def stamp(self, time):
        return self.make("builtin_interfaces/msg/Time", int(time), round(1e9 * (time % 1)))

    def header(self, time, frame):
        fields = (0,) if self.ros == 1 else ()
        stamp = self.stamp(time if self.stopped is None else self.stopped)
        return self.make("std_msgs/msg/Header", *fields, stamp, frame)

    def write(self, topic, time, message):
        kind = message.__msgtype__
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        pack = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        self.writer.write(self.topics[topic], int(1e9 * time), pack(message, kind))

    def scan(
        self,
        time,
        ranges=(2.0, 3.0, 4.0),
        topic="/scan",
        longest=25.0,
        step=0.5,
        frame="laser",
    ):
        message = self.make(
            "sensor_msgs/msg/LaserScan",
            self.header(time, frame),
            -0.5,
            0.5,
            step,
            0.0,
            0.1,
            0.2,
            longest,
            np.array(ranges, np.float32),
            np.zeros(0, np.float32),
        )
        self.write(topic, time, message)

    def transform(self, time, parent, child, position, quaternion, topic="/tf"):
        vector = self.make("geometry_msgs/msg/Vector3", *map(float, position))
        rotation = self.make("geometry_msgs/msg/Quaternion", *quaternion)
        entry = self.make(
            "geometry_msgs/msg/TransformStamped",
            self.header(time, parent),
            child,
            self.make("geometry_msgs/msg/Transform", vector, rotation),
        )
        self.write(topic, time, self.make("tf2_msgs/msg/TFMessage", [entry]))

    def mount(self, roll=0.0, topic="/tf_static"):
        self.transform(0.0, "base_link", "laser", LASER_AT, turn(TURN, roll), topic)

    def drive(self, times=(1.0, 2.0, 3.0), topic="/tf"):
        """Drive along x at 1 m/s."""
        for time in times:
            self.transform(time, "map", "base_link", (time, 0.0, 0.0), turn(0.0), topic)

    def pose(self, time, x, y, yaw, kind="PoseStamped", topic="/pose"):
        point = self.make("geometry_msgs/msg/Point", x, y, 0.0)
        pose = self.make(
            "geometry_msgs/msg/Pose", point, self.make("geometry_msgs/msg/Quaternion", *turn(yaw))
        )
        header, spread = self.header(time, "map"), np.zeros(36)
        with_spread = ("geometry_msgs/msg/PoseWithCovariance", pose, spread)
        if kind == "PoseStamped":
            message = self.make("geometry_msgs/msg/PoseStamped", header, pose)
        elif kind == "PoseWithCovarianceStamped":
            message = self.make(
                "geometry_msgs/msg/PoseWithCovarianceStamped", header, self.make(*with_spread)
            )
        else:
            still = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
            moves = self.make("geometry_msgs/msg/Twist", still, still)
            twist = self.make("geometry_msgs/msg/TwistWithCovariance", moves, spread)
            message = self.make(
                "nav_msgs/msg/Odometry", header, "base_link", self.make(*with_spread), twist
            )
        self.write(topic, time, message)
