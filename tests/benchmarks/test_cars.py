"""Comparisons with the car of a file: settings, overriding options, tasks and calibrations."""

from argparse import ArgumentParser
from dataclasses import asdict, replace

import numpy as np
import pytest
from comparison import results, run

from benchmarks.calibration.certificate import SHIPPED, at_risk, conditions_for
from benchmarks.compare import drive
from benchmarks.runs.arms import ARMS
from benchmarks.runs.car import limits_for
from benchmarks.runs.driver import navigator_config
from benchmarks.runs.saved_run import Run
from benchmarks.runs.settings import OLDER, Settings
from benchmarks.runs.tasks import make_task
from foresee.infra.command_line import UsageError
from foresee.mapping.body import Body, Scene, first_contact
from foresee.mapping.car_file import PRESETS
from foresee.mapping.car_limits import CarLimits
from planner.risk.calibration import CalibrationError


def parsed(*words):
    parser = ArgumentParser()
    Settings.add_to(parser)
    return Settings.of(parser.parse_args([str(word) for word in words]))


def test_without_a_file_the_car_is_that_of_the_published_results():
    assert limits_for(Settings()) == CarLimits()
    assert limits_for(Settings(vehicle="reeds-shepp")) == CarLimits(reverse=0.5)
    turning = CarLimits(reverse=0.5, turn_rate=1.5)
    assert limits_for(Settings(vehicle="differential")) == turning
    assert OLDER["car"] is None


@pytest.mark.parametrize("name", PRESETS)
def test_the_settings_hold_the_whole_car(name):
    settings = parsed("--car", name)
    assert limits_for(settings) == CarLimits.read(name)
    assert settings == Settings.with_defaults(car=name)
    assert navigator_config(settings, ARMS["known"]).car == CarLimits.read(name)
    # They do not depend on the file any more.
    assert limits_for(Settings(**asdict(settings) | {"car": "gone.yaml"})) == CarLimits.read(name)


def test_explicit_options_override_the_file_even_with_a_default_value():
    car = CarLimits.read("f1tenth")
    words = ("--car", "f1tenth")
    assert limits_for(parsed(*words, "--v-max", 4.0)) == replace(car, v_max=4.0)
    assert limits_for(parsed(*words, "--braking", 1.5)) == replace(car, braking=1.5)
    assert limits_for(parsed(*words, "--vehicle", "dubins")) == replace(car, reverse=0.0)
    assert limits_for(parsed(*words, "--vehicle", "reeds-shepp")) == car
    turning = limits_for(parsed(*words, "--vehicle", "differential"))
    assert turning == replace(car, turn_rate=1.5)
    jackal = parsed("--car", "jackal")
    assert jackal.vehicle == "differential"
    assert limits_for(parsed("--car", "jackal", "--vehicle", "reeds-shepp")).turn_rate == 0.0
    paper = limits_for(parsed("--car", "paper", "--vehicle", "reeds-shepp"))
    assert paper.reverse == 0.5


def test_a_run_names_its_car_and_is_not_continued_with_another(short_map, tmp_path, capsys):
    words = ("--world", short_map, "--start", 2, 1.5, 0, "--goal", 6, 1.5, "--arms", "known")
    words += ("--predictor", "none", "--jobs", 1, "--out", tmp_path / "run")
    assert run(*words, "--car", "f1tenth") == 0
    assert "reeds-shepp car f1tenth" in capsys.readouterr().out
    saved = results(tmp_path / "run")["settings"]
    assert (saved["car"], saved["length"], saved["acceleration"]) == ("f1tenth", 0.58, 3.0)
    assert Run.load(tmp_path / "run").body == Body(0.58, 0.31)
    for other in ((), ("--car", "jackal")):
        assert run(*words, *other) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "length 0.58" in said


@pytest.mark.parametrize("words", [("--car", "tank"), ("--car", "missing.yaml"), ("--car", "")])
def test_what_is_no_car_is_refused_in_one_line(words, tmp_path, capsys):
    assert run(*words, "--out", tmp_path / "run") == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert run("--car", "paper", "--optimum", "optimum.json", "--out", tmp_path / "run") == 2
    assert "not of --car" in capsys.readouterr().err


def test_a_drawn_task_has_room_for_the_car():
    large = Settings(world=("office",), length=1.2, width=0.8, turning_radius=1.5)
    task = make_task(large, 0)
    scene = Scene(task.world.solid, *task.world.grid.frame.lattice, *Body(1.2, 0.8).halves)
    assert first_contact(scene, np.array([task.start])) < 0
    usual = make_task(Settings(world=("office",)), 0)
    faster = make_task(Settings(world=("office",), v_max=2.0, acceleration=0.5), 0)
    assert (usual.start, usual.goal) == (faster.start, faster.goal)


def test_a_calibration_is_for_one_car_whatever_its_file_is_called():
    usual = Settings(world=("office",), route="fixed", arms=("predicted",), risk=0.05)
    assert at_risk(usual).level > 0.0
    small = replace(usual, length=0.4)
    with pytest.raises(UsageError, match="no calibration that ships"):
        at_risk(small)
    assert at_risk(replace(small, uncertified=True)).uncertified
    same = replace(usual, car="my_copy_of_the_default.yaml")
    assert conditions_for(same) == conditions_for(usual)


def test_the_command_that_is_proposed_for_a_calibration_names_the_car():
    settings = Settings.with_defaults(
        car="f1tenth", vehicle="dubins", arms=("predicted",), risk=0.05
    )
    with pytest.raises(UsageError, match=r"--car f1tenth --vehicle dubins`"):
        at_risk(settings)


def test_a_calibration_of_another_car_is_refused_with_what_differs():
    office = next(path for path in SHIPPED if "office" in path.name)
    settings = Settings(
        world=("office",), route="fixed", arms=("predicted",), risk=0.05, turning_radius=0.6
    )
    with pytest.raises(CalibrationError, match=r"turning_radius 0\.8, not 0\.6"):
        at_risk(settings, office)


def test_a_drive_in_python_takes_a_car(short_map):
    driven = drive(
        str(short_map),
        car="jackal",
        start=(2.0, 1.5, 0.0),
        goal=(6.0, 1.5),
        arms=("known",),
        predictor="none",
    )
    assert driven.body == Body(0.508, 0.43)
    assert driven.episodes[0].max_speed <= 2.0
