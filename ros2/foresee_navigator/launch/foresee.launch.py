"""Starts the navigator, and with `simulate:=true` a simulated robot."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "foresee_navigator"


def generate_launch_description() -> LaunchDescription:
    """Return the nodes to start."""
    share = FindPackageShare(PACKAGE)
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params",
                default_value=PathJoinSubstitution([share, "config", "navigator.yaml"]),
                description="file with the parameters of foresee_navigator",
            ),
            DeclareLaunchArgument(
                "simulate", default_value="false", description="start a simulated robot, too"
            ),
            Node(
                package=PACKAGE,
                executable="foresee_navigator",
                name="foresee_navigator",
                parameters=[LaunchConfiguration("params")],
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="foresee_simulator",
                name="foresee_simulator",
                parameters=[PathJoinSubstitution([share, "config", "simulator.yaml"])],
                output="screen",
                condition=IfCondition(LaunchConfiguration("simulate")),
            ),
        ]
    )
