"""Time-optimal drives keep the car's limits and its bound; their file grows and is always whole."""

import errno
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.optimal.first_guesses import STEP, candidate_paths, timed
from benchmarks.optimal.minimum_time import MARGINS, signed_distance
from benchmarks.optimal.search import time_optimal
from benchmarks.optimal.shortest_path import path_length, shortest_path, time_bound
from benchmarks.optimum import main
from benchmarks.runs.drive_file import DriveFile, read_drives
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task
from benchmarks.runs.time_optimal import KIND, read_t_opt, task_key
from foresee.infra.command_line import Command, UsageError
from foresee.infra.resumable import lock
from foresee.infra.workers import LostError
from foresee.mapping.car_limits import CarLimits
from foresee.mapping.control import Control
from foresee.mapping.grid import FREE, OCCUPIED, Grid, GridFrame
from sim.car import DubinsCar
from sim.families import empty_straight
from sim.task import Task
from sim.world import World

CAR = CarLimits()
GOAL_RADIUS = 0.5


def corner() -> Task:
    """A way around a wall, from a start that looks away from it."""
    frame = GridFrame(0.05, (0.0, 0.0), (160, 200))
    cells = np.full(frame.shape, FREE, dtype=np.int8)
    cells[:100, 80:100] = OCCUPIED
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    goal = (8.5, 1.5)
    way = np.array([(2.0, 6.0), (6.0, 6.0), goal])
    return Task(World("corner", Grid(frame, cells)), (2.0, 1.5, -2.5), goal, way, 14.5, 0)


def bound(task: Task) -> float:
    way = shortest_path(task.world, task.start[:2], task.goal, CAR.body.half_width)
    return time_bound(path_length(way), CAR, GOAL_RADIUS)


@pytest.fixture(scope="module")
def around():
    """The quickest drive around the corner."""
    drive, _ = time_optimal(corner(), CAR, GOAL_RADIUS)
    return drive


def test_a_straight_corridor_is_driven_at_the_bound():
    world = empty_straight(20.0, 3.0)
    task = Task(world, (2.0, 2.0, 0.0), (18.0, 2.0), np.array([(18.0, 2.0)]), 16.0, 0)
    drive, tried = time_optimal(task, CAR, GOAL_RADIUS)
    assert tried >= 2
    assert bound(task) <= drive.time <= 1.01 * bound(task)


def test_around_a_corner_a_drive_is_slower_than_its_bound(around):
    assert bound(corner()) < around.time < 2.0 * bound(corner())


def test_a_drive_is_what_the_simulators_car_does_with_its_controls(around):
    task, car = corner(), DubinsCar(CAR)
    state = np.array([*task.start, 0.0])
    for control, after in zip(around.controls, around.states[1:], strict=True):
        control = Control(*control)
        assert not car.collides(task.world, state, control, around.dt)
        state = car.step(state, control, around.dt)
        assert np.cos(state[2] - after[2]) == pytest.approx(1.0)
        assert state[[0, 1, 3]] == pytest.approx(after[[0, 1, 3]])
    assert math.dist(state[:2], task.goal) <= GOAL_RADIUS
    assert around.time == around.dt * len(around.controls)


def test_a_drive_keeps_the_cars_limits(around):
    speed, (acceleration, curvature) = around.states[:, 3], around.controls.T
    rounding = 1e-5
    assert speed[0] == 0.0
    assert speed.max() <= CAR.v_max + rounding
    assert -CAR.braking - rounding <= acceleration.min()
    assert acceleration.max() <= CAR.acceleration + rounding
    assert np.abs(curvature).max() <= CAR.max_curvature + rounding
    fastest = np.maximum(speed[1:], speed[:-1])
    assert (fastest**2 * np.abs(curvature)).max() <= CAR.lateral_acceleration + rounding


def test_a_slower_car_takes_longer(around):
    slow = CarLimits(v_max=2.0)
    drive, _ = time_optimal(corner(), slow, GOAL_RADIUS)
    assert drive.time > around.time
    assert drive.states[:, 3].max() <= 2.0 + 1e-5


def test_guesses_begin_at_the_start_and_turn_to_either_side():
    task = corner()
    found = dict(candidate_paths(task, CAR, GOAL_RADIUS))
    assert {"left turn", "right turn"} <= found.keys()
    for name, way in found.items():
        assert way[0] == pytest.approx(task.start[:2], abs=0.01), name
        assert np.hypot(*np.diff(way, axis=0).T).max() < 1.5 * STEP, name
        guess = timed(name, way, task.start[2], CAR, 0.1)
        assert guess.dt <= 0.1
        assert np.isfinite(guess.states).all()
        assert np.isfinite(guess.controls).all()
        assert guess.states[0, 3] == 0.0


def test_a_guess_in_other_ticks_takes_as_long(around):
    finer = around.resampled(2 * len(around.controls))
    assert finer.time == pytest.approx(around.time)
    assert finer.states[::2] == pytest.approx(around.states)
    assert (finer.controls[::2] == around.controls).all()


def test_signed_distance_is_to_the_cells_squares():
    solid = np.random.default_rng(0).random((12, 9)) < 0.2
    found = signed_distance(solid)
    rows, cols = np.nonzero(solid)
    for i, j in np.ndindex(solid.shape):
        if solid[i, j]:
            assert found[i, j] < 0.0
        else:
            beside = np.hypot(
                np.maximum(np.abs(rows - i) - 0.5, 0.0), np.maximum(np.abs(cols - j) - 0.5, 0.0)
            )
            assert found[i, j] == pytest.approx(beside.min())


def test_the_first_margin_is_more_than_the_simulator_grows_a_body_by():
    # Half the distance between two poses that it tests.
    assert MARGINS[0] > 0.5 * 0.2 * 0.05
    assert sorted(MARGINS) == list(MARGINS)


def test_nothing_of_it_needs_the_planner():
    code = (
        "import sys\n"
        "from benchmarks.optimal import first_guesses, minimum_time, shortest_path\n"
        "print(sorted(name for name in sys.modules if name.split('.')[0] == 'planner'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def result(index, t_opt=2.0):
    return {
        "index": index,
        "world": f"w-{index}",
        "seed": index,
        "start": [0.12345, -1e-9, 1.0],
        "goal": [3.0, 4.0],
        "t_opt": t_opt,
        "t_bound": 1.5,
        "shortest": 6.0,
    }


@pytest.fixture
def counted(monkeypatch):
    """The command without its work: the episodes that it works on."""
    done = []

    def found(settings: Settings, index: int):
        done.append(index)
        if index == 3:
            return "w-3: no way"
        return result(index, None if index == 2 else 2.0)

    monkeypatch.setattr("benchmarks.runs.time_optimal.attempt", found)
    return done


def test_a_run_goes_on_where_it_was_and_computes_nothing_twice(tmp_path, counted, capsys):
    out = tmp_path / "sub" / "optimum.json"
    run = ["--jobs", "1", "--out", str(out)]
    assert main([*run, "--episodes", "1"]) == 0
    assert main([*run, "--episodes", "3"]) == 0
    assert main([*run, "--episodes", "2"]) == 0
    assert counted == [0, 1, 2]
    found = read_drives(out, KIND)
    assert [drive["index"] for drive in found["drives"]] == [0, 1, 2]
    assert found["settings"]["episodes"] == 3
    assert list(out.parent.iterdir()) == [out]
    assert "episode 2, w-2: no drive found" in capsys.readouterr().out


def test_a_file_in_use_is_refused(tmp_path, counted, capsys):
    out = tmp_path / "optimum.json"
    with lock(tmp_path / ".optimum.json.lock", out):
        assert main(["--jobs", "1", "--out", str(out), "--episodes", "1"]) == 2
    assert f"{out} is in use: another run is at work there" in capsys.readouterr().err
    assert main(["--jobs", "1", "--out", str(out), "--episodes", "1"]) == 0


def test_an_episode_without_a_drive_is_left_out_and_said_so(tmp_path, counted, capsys):
    out = tmp_path / "optimum.json"
    assert main(["--jobs", "1", "--out", str(out), "--episodes", "5"]) == 0
    assert "episode 3 left out: w-3: no way" in capsys.readouterr().out
    assert [drive["index"] for drive in read_drives(out, KIND)["drives"]] == [0, 1, 2, 4]


def test_times_are_found_by_task_whatever_the_rounding(tmp_path, counted):
    out = tmp_path / "optimum.json"
    main(["--jobs", "1", "--out", str(out), "--episodes", "3"])
    times = read_t_opt(out, Settings())
    assert times[task_key("w-1", 1, (0.1234501, 0.0, 1.0), (3.0, 4.0))] == 2.0
    assert times[task_key("w-2", 2, (0.12345, 0.0, 1.0), (3.0, 4.0))] is None
    assert len(times) == 3
    with pytest.raises(UsageError, match="is of v_max 4, not 3"):
        read_t_opt(out, Settings(v_max=3.0))


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "{}",
        "[]",
        "[" * 100_000,
        '{"kind": "attack"}',
        '{"kind": "x"}',
        '{"command": "benchmarks.optimum", "settings": {}, "drives": []}',
        '{"kind": "optimum", "settings": {}, "drives": [{}]}',
    ],
    ids=["{", "{}", "[]", "deep", "other", "strange", "old", "empty"],
)
def test_a_file_of_something_else_is_named_in_one_line(tmp_path, capsys, text):
    out = tmp_path / "optimum.json"
    out.write_text(text)
    with pytest.raises(
        UsageError, match=r"is no file of|is no results file|does not say what kind"
    ):
        read_t_opt(out)
    assert main(["--out", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert out.read_text() == text


def test_a_missing_file_is_named():
    with pytest.raises(UsageError, match="No such file"):
        read_t_opt(Path("nowhere.json"))


def test_what_cannot_be_used_is_said_in_one_line(tmp_path, counted, capsys):
    out = tmp_path / "optimum.json"
    assert main(["--jobs", "1", "--out", str(out), "--episodes", "1"]) == 0
    capsys.readouterr()
    plain = tmp_path / "plain"
    plain.touch()
    for arguments, words in (
        (["--world", "nowhere"], "'nowhere' is no family"),
        (["--world", "trap", "office", "trap"], "trap is given twice"),
        (["--jobs", "0"], "--jobs is 0, it must lie between 1 and 10000"),
        (["--episodes", "0"], "--episodes is 0"),
        (["--v-max", "nan"], "--v-max is nan"),
        (["--v-max", "3", "--out", str(out)], "holds a run with v_max 4.0"),
        (["--world", "trap", "--seed", "4", "--out", str(out)], "seed 0; choose another"),
        (["--out", str(plain / "optimum.json")], "cannot be"),
    ):
        assert main(arguments) == 2
        assert words in (said := capsys.readouterr().err)
        assert said.count("\n") == 1
    assert counted == [0]


def test_a_file_holds_a_drive_a_line(tmp_path):
    store = DriveFile(tmp_path / "o.json", KIND, {"v_max": 4.0, "episodes": 2}, grows="episodes")
    store.add(result(1))
    store.add(result(0))
    lines = (tmp_path / "o.json").read_text().splitlines()
    assert [json.loads(line.rstrip(","))["index"] for line in lines[1:-1]] == [0, 1]


def test_what_the_disk_or_a_process_loses_is_no_error_of_the_user(tmp_path, monkeypatch, capsys):
    def full(path, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    def deadly(work, todo, jobs):
        yield todo[0], result(0)
        raise LostError(todo[1:])

    def run() -> None:
        store = DriveFile(tmp_path / "o.json", KIND, {"v_max": 4.0, "episodes": 2}, "episodes")
        store.fill(result, [0, 1], 2, str)

    command = Command("drives", None, run)
    with monkeypatch.context() as patched:
        patched.setattr("benchmarks.runs.drive_file.finished", deadly)
        assert command([]) == 1
    assert "again and again: 1; give the same command again" in capsys.readouterr().err
    assert json.loads((tmp_path / "o.json").read_text())["drives"] == [result(0)]
    with monkeypatch.context() as patched:
        patched.setattr("benchmarks.runs.drive_file.write_whole", full)
        assert command([]) == 1
    assert "o.json: OSError: No space left" in capsys.readouterr().err


def test_a_file_whose_text_holds_half_a_surrogate_pair_is_continued(tmp_path):
    settings = {"world": "\ud800", "episodes": 2}
    DriveFile(tmp_path / "o.json", KIND, settings, "episodes").add(result(0))
    assert json.loads((tmp_path / "o.json").read_bytes())["settings"]["world"] == "\ud800"
    assert sorted(DriveFile(tmp_path / "o.json", KIND, settings, "episodes").drives) == [0]


def test_a_file_that_is_older_than_a_setting_is_continued(tmp_path):
    DriveFile(tmp_path / "o.json", KIND, {"v_max": 4.0, "episodes": 2}, "episodes").add(result(0))
    mine = {"v_max": 4.0, "braking": 1.5, "episodes": 2}
    with pytest.raises(UsageError, match="braking 3"):
        DriveFile(tmp_path / "o.json", KIND, mine, "episodes", {"braking": 3.0})
    absent = {"braking": 1.5}
    assert sorted(DriveFile(tmp_path / "o.json", KIND, mine, "episodes", absent).drives) == [0]


def test_the_shipped_drives_are_of_the_default_tasks_and_not_quicker_than_their_bounds():
    path = Path(__file__).parents[2] / "docs/results/optimum-corridor.json"
    times = read_t_opt(path, Settings())
    assert len(times) == 100
    task = make_task(Settings(), 1)
    assert task_key(task.world.name, task.seed, task.start, task.goal) in times
    for drive in read_drives(path, KIND)["drives"]:
        assert drive["t_bound"] <= drive["t_opt"] < 2.0 * drive["t_bound"]
        assert drive["states"][0] == pytest.approx([*drive["start"], 0.0], abs=1e-3)
        assert math.dist(drive["states"][-1][:2], drive["goal"]) <= GOAL_RADIUS + 1e-3
