"""Drives in Python: a building is driven by two arms, and the drives are drawn."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.compare import drive, plot
from benchmarks.figures.animation import roll_out
from foresee.infra.command_line import UsageError
from predictor.extend import Extend
from sim import generate
from sim.task import NoTaskError, sample_task


def test_a_building_is_driven_with_and_without_prediction_and_drawn(tmp_path):
    run = drive(generate("corridor", 3), seed=3, arms=("known", "full"), predictor="none")
    assert [result.arm for result in run.episodes] == ["known", "full"]
    assert all(result.outcome == "reached" for result in run.episodes)
    states = run.trace(0, "full").states
    assert np.hypot(*(states[-1, :2] - run.episodes[0].goal)) < 0.6
    figure = plot(run)
    figure.savefig(tmp_path / "speed_profile.png")
    assert "corridor-3" in figure.axes[0].get_title(loc="left")


def test_a_family_by_name_is_the_building_itself():
    by_name = drive("corridor", seed=3, arms=("full",), predictor="none")
    itself = drive(generate("corridor", 3), seed=3, arms=("full",), predictor="none")
    assert np.array_equal(by_name.trace(0, "full").states, itself.trace(0, "full").states)


def test_a_setting_that_cannot_be_used_is_refused():
    with pytest.raises(UsageError, match="arm"):
        drive("corridor", arms=("nobody",))
    with pytest.raises(UsageError, match="--v-max is 'fast', it must be a number"):
        drive("corridor", v_max="fast")


def test_start_and_goal_may_be_lists_and_arrays():
    task = sample_task(generate("corridor", 3), 3)
    start, goal = list(task.start), np.array(task.goal)
    run = drive("corridor", seed=3, arms=["full"], predictor="none", start=start, goal=goal)
    assert run.episodes[0].start == pytest.approx(start)
    assert run.settings["goal"] == tuple(goal)
    slow = drive("corridor", seed=3, arms=("full",), predictor="none", v_max=np.array(2.0))
    assert slow.settings["v_max"] == 2.0


def test_a_predictor_may_be_a_class():
    by_class = drive("corridor", seed=6, arms=("predicted",), predictor=Extend, route="fixed")
    by_name = drive("corridor", seed=6, arms=("predicted",), predictor="extend", route="fixed")
    assert by_class.settings["predictor"] == "predictor.extend:Extend"
    assert by_class.episodes[0].time == by_name.episodes[0].time


def test_a_predictor_that_no_name_stands_for_is_refused():
    class Local(Extend):
        pass

    with pytest.raises(UsageError, match=r"a name, or a class .* and no Extend"):
        drive("corridor", predictor=Extend())
    with pytest.raises(UsageError, match="not defined in a function"):
        drive("corridor", predictor=Local)


def test_the_name_of_an_arm_gives_no_risk():
    for place in ("corridor", generate("corridor", 3)):
        with pytest.raises(UsageError, match="give the risk with --risk"):
            drive(place, arms=("predicted 2 %",), predictor="none")


@pytest.mark.parametrize("wrong", [{"jobs": 1}, {"risk": (0, 0.02)}, {"episodes": 3}])
def test_an_option_that_changes_no_single_drive_is_refused(wrong):
    with pytest.raises(UsageError, match=f"{next(iter(wrong))}: drive"):
        drive("corridor", **wrong)


def test_a_risk_above_0_is_refused_for_a_building_without_a_name():
    with pytest.raises(UsageError, match="a calibration is for a family or a map file"):
        drive(generate("corridor", 3), arms=("predicted",), predictor="none", risk=0.05)


def test_every_last_resort_stops_in_what_had_been_observed():
    run = drive("corridor", seed=3, arms=("backup",), route="fixed")
    trace = run.trace(0, "backup")
    for tick, controls in enumerate(trace.read("last_resorts")):
        states = roll_out(trace.states[tick], controls, 0.1)
        assert states[-1, 3] == pytest.approx(0.0, abs=1e-3)
        inside, rows, cols = trace.truth.frame.locate(states[:, :2])
        assert inside.all()
        seen = trace.first_seen[rows, cols]
        assert ((seen > 0) & (seen <= tick + 1)).all()


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"calibration": Path("missing.json")}, "calibration"),
        ({"uncertified": True}, "uncertified"),
    ],
)
def test_what_is_for_a_risk_is_refused_without_one(given, name):
    with pytest.raises(UsageError, match=f"--{name} needs a --risk above 0"):
        drive("corridor", **given)


def test_a_route_that_passes_a_place_twice_is_not_prescribed():
    with pytest.raises(NoTaskError, match="passes a place twice"):
        drive("narrow", seed=9120008, arms=("known",), predictor="none", route="fixed")
