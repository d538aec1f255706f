"""Files of tasks: their format, and what is refused."""

import json
import math

import pytest

from foresee.mapping.body import Body
from foresee.mapping.conventions import GOAL_RADIUS
from sim import empty_straight
from sim.task import Rules, find_way, waypoints_along
from sim.task_file import GivenTask, TaskFile, TaskFileError

START, GOAL = [2.0, 1.5, 0.0], [15.0, 1.5]
TASK = {"start": START, "goal": GOAL}
STRAIGHT = empty_straight(20.0, 3.0)


def read(tmp_path, content):
    path = tmp_path / "tasks.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return TaskFile.read(path)


def given(start=START, goal=GOAL):
    return GivenTask(None, tuple(start), tuple(goal), Rules())


def test_a_task_needs_no_more_than_start_and_goal(tmp_path):
    (task,) = read(tmp_path, TASK).tasks
    assert task == given()
    assert task.rules.goal_radius == GOAL_RADIUS


def test_the_file_of_the_barn_worlds_holds_a_task_in_each_of_its_maps(tmp_path):
    content = {
        "start": [-2.0, 3.0, 1.57],
        "goal": [-2.0, 13.0],
        "goal_radius_m": 1.0,
        "time_limit_s": 100,
        "top_speed_m_s": 2.0,
        "path_length_m": {"barn_001": 12.3125, "barn_002": 12.739},
    }
    first, second = read(tmp_path, content).tasks
    assert (first.map, second.map) == ("barn_001", "barn_002")
    assert first.start == second.start == (-2.0, 3.0, 1.57)
    assert first.rules == Rules(1.0, 100.0, 2.0, 2.0, 12.3125)
    assert second.rules.published_length == 12.739


def test_a_field_of_a_task_counts_before_that_of_its_map_and_of_the_file(tmp_path):
    content = {
        "start": START,
        "goal": GOAL,
        "top_speed_m_s": 1.0,
        "time_limit_s": {"a": 20, "b": 30},
        "tasks": [{"map": "a"}, {"map": "b", "top_speed_m_s": 2, "goal": [9, 1]}, {"map": "c"}],
    }
    content["tasks"].append({"map": "a", "time_limit_s": 40, "score_speed_m_s": 3})
    tasks = read(tmp_path, content).tasks
    assert [task.map for task in tasks] == ["a", "b", "c", "a"]
    assert [task.rules.time_limit for task in tasks] == [20.0, 30.0, None, 40.0]
    assert [task.rules.top_speed for task in tasks] == [1.0, 2.0, 1.0, 1.0]
    assert [task.rules.score_speed for task in tasks] == [1.0, 2.0, 1.0, 3.0]
    assert tasks[1].goal == (9.0, 1.0)


WRONG = {
    "[1, 2]": "no object",
    "{": "JSONDecodeError",
    "[" * 100_000: "too deep",
    "\x00": "JSONDecodeError",
    '{"start": [2, 1.5, NaN], "goal": [15, 1.5]}': r"start is .*nan.*must be \[x, y, yaw\]",
    '{"start": [2, 1.5, 0], "start": [2, 1.5, 0], "goal": [15, 1.5]}': "names start twice",
    '{"start": [2, 1.5, 0], "goal": [1e400, 1.5]}': r"goal is .*must be \[x, y\]",
}
WRONG |= {
    json.dumps(content): message
    for content, message in (
        ({}, "task 0 has no start"),
        ({"start": START}, "task 0 has no goal"),
        (TASK | {"start": [2, 1.5]}, "start is .*yaw"),
        (TASK | {"goal": "door"}, "goal is 'door'"),
        (TASK | {"goal": [True, 1.5]}, "goal is"),
        (TASK | {"goal_radius": 1.0}, "field 'goal_radius'; there are .*goal_radius_m"),
        (TASK | {"goal_radius_m": 0.1}, "goal_radius_m is 0.1, .* from 0.5 to 100"),
        (TASK | {"top_speed_m_s": "2"}, "top_speed_m_s is '2'"),
        (TASK | {"time_limit_s": 0}, "time_limit_s is 0"),
        (TASK | {"path_length_m": -1}, "path_length_m is -1"),
        (TASK | {"goal": [2.1, 1.5]}, r"task 0: start .* within 0\.5 m of the goal"),
        (TASK | {"map": 3}, "map is 3"),
        (TASK | {"tasks": []}, r"tasks is \[\]"),
        (TASK | {"tasks": {"a": 1}}, "tasks is"),
        (TASK | {"tasks": [3]}, "task 0 is 3"),
        (TASK | {"tasks": [{"map": "a", "gaol": [3, 4]}]}, "task 0 has a field 'gaol'"),
        (TASK | {"tasks": [{"map": "a"}, {"map": "b"}, {"map": "a"}]}, "task 2 is the same as"),
        (TASK | {"time_limit_s": {"b": 9}, "tasks": [{"map": "a"}]}, "no task in b"),
        ({"start": {"a": START}, "goal": {"b": GOAL}}, r"task 0 \(a\) has no goal"),
    )
}


@pytest.mark.parametrize("content", WRONG)
def test_a_broken_file_is_refused_in_one_line_that_names_the_fault(tmp_path, content):
    with pytest.raises(TaskFileError, match=WRONG[content]) as refused:
        read(tmp_path, content)
    assert "\n" not in str(refused.value)
    assert "tasks.json is no file of tasks" in str(refused.value)


def test_a_path_that_no_file_can_have_is_refused(tmp_path):
    for path in (tmp_path / "missing.json", tmp_path / "\0"):
        with pytest.raises(TaskFileError):
            TaskFile.read(path)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ({"start": [2.0, 0.16, 0.0]}, "start .* wall"),
        ({"start": [-1e9, 1.5, 0.0]}, "start .* outside of the map"),
        ({"goal": [15.0, 0.01]}, "goal .* wall"),
        ({"goal": [1e9, 1.5]}, "goal .* outside of the map"),
    ],
)
def test_a_start_or_goal_that_is_not_free_is_refused(ends, message):
    given().check_ends(STRAIGHT, Body())
    with pytest.raises(TaskFileError, match=message):
        given(**ends).check_ends(STRAIGHT, Body())


def test_a_way_leads_to_the_goal_itself():
    way = find_way(STRAIGHT, tuple(START), tuple(GOAL), 1.0)
    assert way[0].tolist() == START[:2]
    waypoints = waypoints_along(way)
    assert waypoints[-1].tolist() == GOAL
    assert len(waypoints) == pytest.approx(math.dist(START[:2], GOAL) / 2.0, abs=1)


def test_there_is_no_way_to_a_goal_behind_the_car_where_it_cannot_turn():
    narrow = empty_straight(20.0, 1.5)
    ahead, behind = (15.0, 0.75), (2.0, 0.75)
    assert find_way(narrow, (10.0, 0.75, 0.0), ahead, 0.5) is not None
    assert find_way(narrow, (10.0, 0.75, 0.0), behind, 0.5) is None
