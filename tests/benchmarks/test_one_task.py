"""Comparisons of one task between --start and --goal, in a map or in a generated building."""

from argparse import ArgumentParser
from dataclasses import replace

import pytest
from comparison import results, run

from benchmarks.calibration.certificate import at_risk
from benchmarks.compare import drive
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import input_hashes, make_task
from benchmarks.tables import main as tables
from foresee.infra.command_line import UsageError
from sim.buildings import task_in
from sim.task_file import TaskFileError

START, GOAL = (2.0, 1.5, 0.0), (6.0, 1.5)
ENDS = ("--start", *START, "--goal", *GOAL)


@pytest.mark.drawn
def test_a_run_of_one_task_is_saved_shown_and_continued(short_map, tmp_path, capsys):
    words = ("--world", short_map, "--arms", "known", "--predictor", "none", "--jobs", 1)
    out = ("--out", tmp_path / "run")
    assert run(*words, *ENDS, *out) == 0
    assert "from (2, 1.5, 0) to (6, 1.5)" in capsys.readouterr().out
    saved = results(tmp_path / "run")
    assert (saved["settings"]["start"], saved["settings"]["goal"]) == ([*START], [*GOAL])
    (episode,) = saved["episodes"]
    assert (episode["start"], episode["goal"], episode["outcome"]) == ([*START], [*GOAL], "reached")
    assert (tmp_path / "run" / "trajectories.png").exists()
    assert run(*words, *ENDS, *out) == 0
    assert results(tmp_path / "run")["episodes"] == saved["episodes"]
    capsys.readouterr()
    assert tables([str(tmp_path / "run" / "results.json")]) == 0
    assert "to (6, 1.5)" in capsys.readouterr().out
    for other in ((), ("--start", 2.5, 1.5, 0.0, "--goal", *GOAL)):
        assert run(*words, *other, *out) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "start [2.0, 1.5, 0.0]" in said


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--start", 2, 1.5, 0), "--start needs --goal"),
        (("--goal", 6, 1.5), "--goal needs --start"),
        (("--start", 2, 1.5, "--goal", 6, 1.5), "expected 3 arguments"),
        ((*ENDS, 0), "unrecognized arguments: 0"),
        (("--start", 2, "nan", 0, "--goal", 6, 1.5), "--start is nan"),
        (("--start", 0, 0, 0, "--goal", 6, 1.5), "in straight: there the car's body is in a wall"),
        (("--start", 2, 1.5, 0, "--goal", 60, 1.5), "goal [60.0, 1.5] in straight is in a wall"),
        (("--start", 2, 1.5, 0, "--goal", 2.4, 1.5), "within 0.5 m of the goal"),
        ((*ENDS, "--world", "corridor", "office"), "a task in one building, --world names 2"),
        ((*ENDS, "--tasks", "tasks.json"), "give only one"),
        ((*ENDS, "--optimum", "optimum.json"), "its times are those of drawn tasks"),
        ((*ENDS, "--risk", 0.05), "not for those of --start"),
    ],
)
def test_what_is_no_task_is_refused_in_one_line(words, why, short_map, tmp_path, capsys):
    assert run("--world", short_map, *words, "--out", tmp_path / "run") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert why in said
    assert not (tmp_path / "run").exists()


def test_in_python_the_ends_have_their_numbers_of_coordinates():
    with pytest.raises(UsageError, match=r"--start is \(1\.0, 2\.0\), it must be X Y YAW"):
        Settings(start=(1.0, 2.0), goal=GOAL)


def test_a_generated_building_is_that_of_the_seed_in_every_drive():
    drawn = task_in("corridor", 3)
    settings = Settings(world=("corridor",), seed=3, start=drawn.start, goal=drawn.goal)
    assert input_hashes(settings) == {}
    first, second = (make_task(settings, index) for index in (0, 1))
    assert first.world.name == second.world.name == drawn.world.name
    assert (first.world.grid.cells == drawn.world.grid.cells).all()
    assert (first.start, first.goal, first.seed, second.seed) == (drawn.start, drawn.goal, 3, 4)
    # The route from a drawn start to a drawn goal may be shorter than the drawn one.
    assert first.path_length <= drawn.path_length + 1.0
    with pytest.raises(TaskFileError, match=r"start .* in corridor"):
        input_hashes(replace(settings, start=(-500.0, 0.0, 0.0)))


def test_a_task_is_driven_once_unless_the_number_of_episodes_is_given():
    def episodes(*words):
        parser = ArgumentParser()
        Settings.add_to(parser)
        return Settings.of(parser.parse_args([str(word) for word in words])).episodes

    assert episodes() == 12
    assert episodes(*ENDS) == 1
    assert episodes(*ENDS, "--episodes", 12) == 12
    assert episodes(*ENDS, "--episodes", 3) == 3


def test_a_drive_in_python_takes_a_start_and_a_goal(short_map):
    run = drive(str(short_map), start=START, goal=GOAL, arms=("known",), predictor="none")
    assert (run.episodes[0].start, run.episodes[0].goal) == ([*START], [*GOAL])
    assert run.episodes[0].outcome == "reached"


def test_no_calibration_is_for_a_given_task():
    settings = Settings(arms=("predicted",), risk=0.05, start=START, goal=GOAL)
    with pytest.raises(UsageError, match="not for those of --start"):
        at_risk(settings)
    assert at_risk(replace(settings, route="fixed", uncertified=True)).uncertified
