"""Comparisons whose tasks a file gives: rules, maps, identity of the run, and the BARN score."""

import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from comparison import results, run
from drive_results import a_result

from benchmarks.calibration.certificate import at_risk
from benchmarks.runs.drive import attempt, drive
from benchmarks.runs.settings import Settings
from benchmarks.runs.statistics import barn_score
from benchmarks.runs.summary import summarise
from benchmarks.runs.summary_text import table
from benchmarks.runs.tasks import input_hashes, make_task
from foresee.infra.command_line import UsageError
from foresee.infra.workers import WorkersError
from sim import empty_straight, save_world
from sim.task_file import TaskFileError

TASK = {
    "map": "straight",
    "start": [2.0, 1.5, 0.0],
    "goal": [9.0, 1.5],
    "goal_radius_m": 1.0,
    "time_limit_s": 30,
    "top_speed_m_s": 1.5,
    "path_length_m": 8.0,
}


def written(folder, *tasks):
    path = folder / "tasks.json"
    path.write_text(json.dumps({"tasks": list(tasks)}))
    return path


def settings_of(tasks, *maps, **changes):
    plain = {"arms": ("known",), "predictor": "none", "episodes": 1}
    return Settings(world=tuple(map(str, maps)), tasks=str(tasks), **plain | changes)


def test_a_drive_keeps_to_the_rules_of_its_task_and_its_result_names_them(tmp_path, short_map):
    result, trace = drive(settings_of(written(tmp_path, TASK), short_map), 0, "known")
    assert result.outcome == "reached"
    assert result.start == TASK["start"]
    assert result.goal == TASK["goal"]
    for field, name in (
        ("goal_radius", "goal_radius_m"),
        ("time_limit", "time_limit_s"),
        ("top_speed", "top_speed_m_s"),
        ("score_speed", "top_speed_m_s"),
        ("published_length", "path_length_m"),
    ):
        assert getattr(result, field) == TASK[name]
    assert 1.4 < result.max_speed <= 1.5
    off = np.hypot(*(trace.states[:, :2] - TASK["goal"]).T)
    assert off[-1] <= 1.0 < off[-2]
    # From rest to 1.5 m/s in 0.75 m, then on to 1 m from the goal.
    assert result.t_bound == pytest.approx(1.0 + (7.0 - 1.0 - 0.75) / 1.5)
    assert result.t_star == pytest.approx(8.0 / 1.5)


def test_a_drive_ends_at_the_time_limit_of_its_task(tmp_path, short_map):
    tasks = written(tmp_path, TASK | {"time_limit_s": 2})
    result = drive(settings_of(tasks, short_map), 0, "known").result
    assert (result.outcome, result.time) == ("timed_out", pytest.approx(2.0))


def test_the_last_task_is_followed_by_the_first_with_the_next_seed(tmp_path, short_map):
    settings = settings_of(written(tmp_path, TASK, TASK | {"goal": [12.0, 1.5]}), short_map)
    tasks = [make_task(settings, index) for index in range(3)]
    assert [task.goal[0] for task in tasks] == [9.0, 12.0, 9.0]
    assert [task.seed for task in tasks] == [0, 0, 1]
    assert tasks[0].path_length == pytest.approx(7.0, abs=0.3)


def test_a_goal_that_only_a_car_in_reverse_reaches_is_a_task(tmp_path):
    save_world(empty_straight(20.0, 1.5), tmp_path / "narrow.yaml")
    behind = {"start": [10.0, 0.75, 0.0], "goal": [2.0, 0.75]}
    task = make_task(settings_of(written(tmp_path, behind), tmp_path / "narrow.yaml"), 0)
    assert task.path_length == pytest.approx(8.0)
    assert task.waypoints[-1].tolist() == behind["goal"]


def test_tasks_are_of_the_maps_that_world_names(tmp_path, short_map):
    other, double = tmp_path / "other.yaml", tmp_path / "sub"
    double.mkdir()
    for path in (other, double / "straight.yaml"):
        save_world(empty_straight(20.0, 3.0), path)
    tasks = written(tmp_path, TASK)
    assert set(input_hashes(settings_of(tasks, short_map, other))) == {
        *map(str, (short_map, other, tasks))
    }
    for maps, message in (
        ((other,), "no map straight"),
        ((short_map, double), "more than one map straight"),
        (("corridor",), "without families"),
    ):
        with pytest.raises(UsageError, match=message):
            input_hashes(settings_of(tasks, *maps))
    nameless = {name: value for name, value in TASK.items() if name != "map"}
    assert make_task(settings_of(written(tmp_path, nameless), short_map), 0).goal == (9.0, 1.5)
    with pytest.raises(UsageError, match="must name its map"):
        input_hashes(settings_of(written(tmp_path, nameless), short_map, other))
    walled = written(tmp_path, TASK | {"start": [0.0, 0.0, 0.0]})
    with pytest.raises(TaskFileError, match=r"start .* in straight: .* wall"):
        input_hashes(settings_of(walled, short_map))


def test_a_run_is_not_continued_with_edited_tasks(tmp_path, short_map, capsys):
    tasks, out = written(tmp_path, TASK), tmp_path / "run"
    words = ("--world", short_map, "--tasks", tasks, "--episodes", 1, "--arms", "known")
    words += ("--predictor", "none", "--jobs", 1, "--out", out)
    assert run(*words) == 0
    said = capsys.readouterr().out
    assert f"tasks {tasks}" in said
    assert "v_max 1.5 m/s" in said
    assert re.search(r"\*\*BARN score\*\*, at most 0\.25[^|]*\| 0\.250", said)
    assert r"| T\*/time" in said
    (episode,) = results(out)["episodes"]
    assert (episode["goal_radius"], episode["time_limit"], episode["top_speed"]) == (1.0, 30, 1.5)
    assert run(*words) == 0
    capsys.readouterr()
    written(tmp_path, TASK | {"goal_radius_m": 1.1})
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "tasks.json" in said
    tasks.write_text("[")
    assert run(*words) == 2
    assert capsys.readouterr().err.count("\n") == 1
    shutil.rmtree(out)
    assert run(*words[:2], *words[4:]) == 0
    assert "BARN" not in capsys.readouterr().out


def test_no_calibration_is_for_given_tasks(tmp_path, short_map):
    settings = settings_of(
        written(tmp_path, TASK), short_map, arms=("predicted",), predictor="compact", risk=0.05
    )
    with pytest.raises(UsageError, match="not for those of --tasks"):
        at_risk(settings)
    assert at_risk(replace(settings, route="fixed", uncertified=True)).uncertified


def test_a_worker_refuses_tasks_that_were_edited_during_the_run(tmp_path, short_map):
    settings = settings_of(written(tmp_path, TASK), short_map)
    hashes = input_hashes(settings)
    assert not isinstance(attempt(settings, None, (0, "known"), hashes), str)
    written(tmp_path, TASK | {"time_limit_s": 29})
    with pytest.raises(WorkersError, match=r"another file .*tasks\.json"):
        attempt(settings, None, (0, "known"), hashes)


def scored(time, outcome="reached", **changes):
    """A drive with a T* of 5 s."""
    plain = {"score_speed": 2.0, "published_length": 10.0, "shortest_length": 9.0}
    return a_result(time=time, outcome=outcome, **plain | changes)


@pytest.mark.parametrize(
    ("time", "outcome", "cut", "uncut"),
    [
        (4.0, "reached", 1 / 4, 5 / 4),
        (20.0, "reached", 1 / 4, 1 / 4),
        (30.0, "reached", 1 / 6, 1 / 6),
        (50.0, "reached", 1 / 8, 1 / 10),
        (10.0, "collided", 0.0, 0.0),
        (100.0, "timed_out", 0.0, 0.0),
    ],
)
def test_the_barn_score_is_that_of_the_challenge(time, outcome, cut, uncut):
    arms = {"known": [scored(time, outcome)]}
    assert barn_score(arms, "known", cut=True)["value"] == pytest.approx(cut)
    assert barn_score(arms, "known", cut=False)["value"] == pytest.approx(uncut)


def test_the_barn_score_is_a_mean_over_all_tasks_with_a_shortest_path():
    known = [scored(30.0), scored(10.0, "stuck"), scored(30.0, published_length=None)]
    known.append(scored(1.0, published_length=None, shortest_length=None))
    assert barn_score({"known": known}, "known", cut=True)["value"] == pytest.approx(
        (1 / 6 + 0.0 + 4.5 / 30) / 3
    )
    assert barn_score({"known": [a_result()]}, "known", cut=True) is None


def test_only_tables_of_tasks_with_a_t_star_have_rows_of_the_barn_score():
    with_t_star = table(summarise([scored(30.0)], ("known",)), {})
    assert "BARN" not in table(summarise([a_result()], ("known",)), {})
    rows = {line.split("|")[1].strip(): line for line in with_t_star.splitlines() if "|" in line}
    (cut,) = (line for row, line in rows.items() if "BARN" in row)
    assert math.isclose(float(cut.split("|")[2].split()[0]), 1 / 6, abs_tol=1e-3)
    assert any(row.startswith(r"T\*/time") for row in rows)
