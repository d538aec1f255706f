"""The files of the ROS package agree with its code and its page."""

import ast
import json
import re
from dataclasses import fields
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from foresee_navigator.settings import (
    CarSettings,
    NavigatorSettings,
    SimulatorSettings,
    described,
)

from foresee.mapping.car_limits import CarLimits

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros2/foresee_navigator"
PAGE = ROOT / "docs/how-to/run_on_ros_2.md"
NODES = {"navigator": NavigatorSettings, "simulator": SimulatorSettings}
TOPICS = set(re.findall(r"^\| `/?(\w+)` \|", PAGE.read_text().split("## Parameters")[0], re.M))


@pytest.mark.parametrize("name", NODES)
def test_the_file_of_parameters_has_them_all_with_their_defaults(name):
    text = (PACKAGE / f"config/{name}.yaml").read_text()
    values = yaml.safe_load(text)[f"foresee_{name}"]["ros__parameters"]
    assert values == {f.name: f.default for f in fields(NODES[name])}
    assert NODES[name](**values) == NODES[name]()
    for setting in fields(NODES[name]):
        assert f"# {described(setting)}\n" in text


@pytest.mark.parametrize("name", NODES)
def test_the_page_describes_all_parameters(name):
    own = [f for f in fields(NODES[name]) if name == "navigator" or f not in fields(CarSettings)]
    text = PAGE.read_text()
    for setting in own:
        assert f"| {described(setting)} |" in text, setting.name


def test_every_number_has_limits_that_its_default_keeps():
    for kind in NODES.values():
        kind()
    with pytest.raises(ValueError, match=r"v_max is -1\.0"):
        NavigatorSettings(v_max=-1.0)
    with pytest.raises(ValueError, match="one of twist, twist_stamped, ackermann"):
        NavigatorSettings(command="boat")
    with pytest.raises(ValueError, match="without clock"):
        SimulatorSettings(speed_of_time=2.0)


def test_a_robot_may_be_given_by_its_preset_or_its_file(tmp_path):
    assert NavigatorSettings(robot="jackal").navigator.car == CarLimits.read("jackal")
    path = tmp_path / "mine.yaml"
    path.write_text((ROOT / "foresee/mapping/cars/delivery.yaml").read_text())
    assert SimulatorSettings(robot=str(path)).car == CarLimits.read("delivery")
    assert NavigatorSettings(v_max=1.5).car.v_max == 1.5
    with pytest.raises(ValueError, match="'tank' is no car"):
        _ = NavigatorSettings(robot="tank").car


def test_the_views_show_topics_of_the_page():
    rviz = yaml.safe_load((PACKAGE / "rviz/foresee.rviz").read_text())["Visualization Manager"]
    shown = {display["Topic"]["Value"] for display in rviz["Displays"]}
    layout = json.loads((PACKAGE / "foxglove/foresee.json").read_text())["configById"]
    drawn = {name.strip("/") for name in layout["3D!maps"]["topics"]}
    assert shown == drawn
    assert shown <= TOPICS
    assert {p["value"].split(".")[0].strip("/") for p in layout["Plot!speed"]["paths"]} <= TOPICS


def test_what_setup_installs_exists_and_its_programs_have_a_main():
    text = (PACKAGE / "setup.py").read_text()
    for name in re.findall(r'"((?:config|launch|rviz|foxglove)/[\w.]+)"', text):
        assert (PACKAGE / name).is_file(), name
    assert (PACKAGE / "resource/foresee_navigator").is_file()
    for module in re.findall(r"\{NAME\}\.(\w+):main", text):
        tree = ast.parse((PACKAGE / f"foresee_navigator/{module}.py").read_text())
        assert any(isinstance(n, ast.FunctionDef) and n.name == "main" for n in tree.body)
    launched = (PACKAGE / "launch/foresee.launch.py").read_text()
    for program in re.findall(r'executable="(\w+)"', launched):
        assert f'f"{program} = ' in text


def test_the_manifest_names_every_package_of_messages_that_is_imported():
    manifest = ElementTree.parse(PACKAGE / "package.xml")
    named = {element.text for element in manifest.iter("exec_depend")}
    imported = set()
    for path in (PACKAGE / "foresee_navigator").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                imported.add(node.module.split(".")[0])
    assert {name for name in imported if name.endswith(("_msgs", "_interfaces"))} <= named
    assert "rclpy" in named


def test_only_some_modules_need_ros():
    needing = {
        path.stem
        for path in (PACKAGE / "foresee_navigator").glob("*.py")
        if re.search(
            r"^(?:from|import) (?:rclpy|\w+_msgs|\w+_interfaces)\b", path.read_text(), re.M
        )
    }
    assert needing == {
        "frames",
        "messages",
        "navigator_node",
        "parameters",
        "publishers",
        "running",
        "simulator_node",
    }
