"""Builds the ROS 2 package, for colcon and for pip."""

from setuptools import setup

NAME = "foresee_navigator"
SHARE = f"share/{NAME}"

setup(
    name=NAME,
    version="1.0.0",
    description="ROS 2 nodes of foresee: a navigator, and a simulated robot",
    license="MIT",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/config", ["config/navigator.yaml", "config/simulator.yaml"]),
        (f"{SHARE}/launch", ["launch/foresee.launch.py"]),
        (f"{SHARE}/rviz", ["rviz/foresee.rviz"]),
        (f"{SHARE}/foxglove", ["foxglove/foresee.json"]),
    ],
    # foresee itself is installed from its checkout; the messages are those of the ROS installation.
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"foresee_navigator = {NAME}.navigator_node:main",
            f"foresee_simulator = {NAME}.simulator_node:main",
        ],
    },
)
