"""An installed wheel has the packages without studies and tests, and works outside a checkout."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from benchmarks.calibration.certificate import SHIPPED
from foresee.__main__ import COMMANDS, STUDIES
from foresee.mapping.car_file import PRESETS
from sim.suite import suites

ROOT = Path(__file__).parents[1]
PACKAGES = ("foresee", "planner", "predictor", "sim", "benchmarks")
LIBRARIES = [path for path in sys.path if path.endswith("-packages")]

pytestmark = pytest.mark.slow


def python(*words, path, cwd):
    """Run Python without .pth files: an editable installation of a checkout is not found."""
    return subprocess.run(
        [sys.executable, "-S", *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": ":".join(map(str, path)), "PATH": ""},
        check=False,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel of the checkout, built without the network from a copy, which stays clean."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in (*PACKAGES, "tests"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir", str(folder)]
    subprocess.run([*pip, *offline, str(folder / "source")], check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory):
    """A folder that the wheel is installed in."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def test_the_wheel_holds_the_packages_and_neither_studies_nor_tests(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    folders = {name.split("/")[0] for name in names if ".dist-info" not in name}
    assert folders == set(PACKAGES)
    assert {f"{package}/py.typed" for package in PACKAGES} <= names
    assert "foresee/__init__.pyi" in names
    weights = {f"predictor/{path.name}" for path in (ROOT / "predictor").glob("*.safetensors")}
    assert weights
    assert weights <= names
    assert {f"foresee/mapping/cars/{name}.yaml" for name in PRESETS} <= names
    assert {f"benchmarks/calibration/shipped/{path.name}" for path in SHIPPED} <= names
    assert {f"sim/suites/{name}.json" for name in suites()} <= names
    texts = {path.name for path in (ROOT / "benchmarks/report").iterdir() if path.suffix != ".py"}
    assert texts - {"__pycache__"} == {"replay.js", "report.css", "report.html"}
    assert {f"benchmarks/report/{name}" for name in texts - {"__pycache__"}} <= names
    assert not [name for name in names if name.startswith("benchmarks/studies")]


def test_an_installation_lists_the_commands_and_no_study(site, tmp_path):
    done = python("-m", "foresee", path=[site, *LIBRARIES], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    listed = [line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ")]
    assert sorted(listed) == sorted(COMMANDS)


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_refused_in_one_line(name, site, tmp_path):
    done = python("-m", "foresee", name, path=[site, *LIBRARIES], cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"foresee {name}: a study, which only a checkout of foresee has\n"


def test_tables_of_a_study_are_refused_in_one_line(site, tmp_path):
    results = ROOT / "docs/results/attack.json"
    done = python("-m", "foresee", "tables", results, path=[site, *LIBRARIES], cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "the study that makes its tables is not installed" in done.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name, site, tmp_path):
    done = python("-m", "foresee", name, "--help", path=[site, *LIBRARIES], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("usage: ")
