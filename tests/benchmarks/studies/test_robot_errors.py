"""The worst errors keep to their bounds, and the studies of errors judge drives by the body."""

import json
import math

import numpy as np
import pytest

from benchmarks.runs.car import limits_for
from benchmarks.runs.settings import Settings
from benchmarks.studies.robustness import attack, errors
from benchmarks.studies.robustness.among_people import first_touch
from benchmarks.studies.robustness.error_drives import cases_of, driven_case
from benchmarks.studies.robustness.error_tables import table
from benchmarks.studies.robustness.hostile_drives import attacked, driven, failures, reached
from benchmarks.studies.robustness.late_predictor import LateAsker
from benchmarks.studies.robustness.scenario import HONEST_EACH, Scenario
from benchmarks.studies.robustness.worst_errors import (
    LONGEST_BURST,
    POSES,
    RANGES,
    TIMES,
    YAWS,
    WorstErrors,
    WorstLidar,
    WorstRobot,
)
from foresee.mapping.body import Body
from foresee.mapping.control import Control
from foresee.mapping.conventions import TICK
from foresee.prediction import View
from planner.risk.ask_predictor import LateError
from predictor.free import Free
from sim import Lidar, LidarConfig
from sim.families import generate

SETTINGS = Settings(delay=0.1, jitter=0.05, pose_error=0.05, yaw_error=0.02, noise=0.01, missed=0.5)


@pytest.fixture(scope="module")
def world():
    return generate("office", 3)


@pytest.mark.parametrize("way", range(6))
def test_the_worst_errors_reach_their_bounds_and_keep_to_them(world, way):
    worst = WorstErrors(POSES[way], YAWS[way % 4], TIMES[way % 5], RANGES[way % 4], 0.8)
    robot = WorstRobot(worst, SETTINGS, world, np.random.default_rng(0))
    state = np.array([*world.grid.frame.centre(*np.argwhere(world.grid.free)[7]), 0.3, 1.0])
    for _ in range(50):
        x, y, yaw, v = robot.estimate(state) - state
        assert math.hypot(x, y) == pytest.approx(0.05)
        assert math.hypot(x, y) <= 0.05
        assert abs(yaw) == pytest.approx(0.02)
        assert v == 0.0
    late = {robot.actuators.lateness(Control(a, 0.0)) for a in (1.0, -1.0, 1.0, -1.0)}
    assert late <= {0.0, 1.0}
    missed = "".join("x" if robot.misses() else "." for _ in range(3000))
    assert missed[0] == "."
    assert 3 < max(map(len, missed.split("."))) <= 2 * LONGEST_BURST


def test_a_car_that_seems_away_from_a_wall_is_nearer(world):
    worst = WorstErrors("away", "from the wall", "late", "long", 0.8)
    robot = WorstRobot(worst, SETTINGS, world, np.random.default_rng(0))
    far, frame = world.clearance, world.grid.frame
    cells = np.argwhere((far > 0.3) & (far < 0.4))[::50]
    nearer = 0
    for cell in cells:
        state = np.array([*frame.centre(*cell), 0.0, 0.0])
        estimate = robot.estimate(state)
        solid = np.argwhere(world.solid)[:, ::-1] * frame.resolution + frame.origin
        off = [np.hypot(*(solid - s[:2]).T).min() for s in (state, estimate)]
        nearer += off[1] > off[0]
    assert nearer > 0.9 * len(cells)


@pytest.mark.parametrize("sign", RANGES)
def test_the_worst_ranges_are_wrong_by_their_bound(world, sign):
    pose = (*world.grid.frame.centre(*np.argwhere(world.clearance > 0.5)[0]), 0.0)
    exact = Lidar().scan(world, pose).ranges
    lidar, rng = WorstLidar(LidarConfig(), sign, 0.03), np.random.default_rng(0)
    off = np.concatenate([lidar.scan(world, pose, rng).ranges - exact for _ in range(2)])
    off = off[np.isfinite(off)]
    assert np.abs(off) == pytest.approx(0.03)
    assert set(np.sign(off)) == {"long": {1.0}, "short": {-1.0}}.get(sign, {-1.0, 1.0})


def test_with_errors_some_predictors_are_honest_and_the_drives_without_stay_the_same():
    drawn = [Scenario.draw(index, 7, errors=True) for index in range(200)]
    assert [s.index for s in drawn if s.honest] == [*range(0, 200, HONEST_EACH)]
    assert {s.settings.v_max for s in drawn} == {1.0, 2.0, 4.0, 6.0, 8.0}
    assert max(s.settings.bounds.position for s in drawn) == 0.05
    assert Scenario.draw(3, 7).worst is None
    exact = drawn[0].without_errors()
    assert exact.settings.bounds == Settings().bounds
    assert exact.robot(exact.task().world, np.random.default_rng(0)) is None


@pytest.mark.parametrize("index", [1, 2, 4])
def test_a_drive_with_the_worst_errors_ends_well(index):
    found = attacked(attack.SEED, 2.0, index, errors=True)
    assert list(failures([found])) == []
    assert found["errors"]


def test_the_drives_that_reach_their_goal_are_counted_in_pairs():
    drives = [
        {"outcome": a, "without_errors": b}
        for a, b in [("reached", "reached"), ("stuck", "reached"), ("stuck", "stuck")]
    ]
    assert list(reached(drives).values()) == [3, 1, 2, 1, 0]


def test_maps_need_errors(tmp_path, capsys):
    assert attack.main(["--maps", "x.yaml", "--out", str(tmp_path / "a.json")]) == 2
    assert "--errors" in capsys.readouterr().err


def test_a_person_in_the_way_is_touched_when_the_body_is_there():
    # A car at 2 m/s along x, and a person who stands 1 m ahead of its front.
    x = np.arange(10) * 0.2
    states = np.column_stack([x, 0 * x, 0 * x, 0 * x + 2.0])
    places = np.tile([[[1.5, 0.0], [0.0, 3.0]]], (10, 1, 1))
    touch = first_touch(states, places, Body(0.5, 0.3))
    assert touch["at"] == pytest.approx(0.5, abs=0.006)
    assert touch["speed"] == 2.0
    assert not touch["rest"]
    assert first_touch(states, places + np.array([0.0, 0.5]), Body(0.5, 0.3)) is None
    # A person who walks into a car that stands.
    states[:, [0, 3]] = 0.0
    places = np.column_stack([1.0 - 0.14 * np.arange(10), 0 * x])[:, None]
    assert first_touch(states, places, Body(0.5, 0.3))["rest"]


def test_errors_far_beyond_the_bounds_lead_to_contacts():
    cases = cases_of("beyond")
    index = cases.index({"setting": "delay", "factor": 5.0})
    found = driven_case("beyond", errors.SEED, index)
    assert found["touched"]
    assert "1 of 1" in table("beyond", [found])


@pytest.mark.parametrize("part", errors.PARTS)
def test_each_part_of_the_study_makes_a_table_of_its_cases(part):
    assert table(part, []).count("\n") > 6


def test_a_car_drives_on_predictions_that_come_late():
    cases = cases_of("late")
    index = cases.index({"family": "corridor", "arm": "predicted", "ticks": 2})
    found = driven_case("late", errors.SEED, index)
    assert found["outcome"] == "reached"
    # Each question is asked when the answer before is there, so one is late in every tick.
    assert found["faults"]["predictor_late"] == round(found["time"] / TICK)


def test_an_answer_that_is_late_is_handed_out_once_in_its_tick():
    asked = []

    class Counting(Free):
        def predict(self, view):
            asked.append(view)
            return super().predict(view)

    view = View.of(generate("office", 3).grid, np.zeros(3), 5.0, 0.0)
    asker = LateAsker(Counting(), 2)
    got = []
    for _ in range(5):
        # As the navigator does in each tick.
        got.append(asker.take_late() if asked else None)
        with pytest.raises(LateError):
            asker.ask(view, 10.0)
    assert [answer is not None for answer in got] == [False, False, True, False, True]
    assert len(asked) == 3


def test_the_study_goes_on_where_it_was(tmp_path, monkeypatch, capsys):
    made = []

    def drive(part, seed, index):
        made.append(index)
        return {"index": index, "building": 0, "outcome": "no task", "note": ""}

    monkeypatch.setattr("benchmarks.studies.robustness.error_drives.driven_case", drive)
    command = ["--part", "people", "--jobs", "1", "--out", str(tmp_path / "e.json")]
    assert errors.main([*command, "--buildings", "1"]) == 0
    assert errors.main([*command, "--buildings", "2"]) == 0
    assert made == [*range(12)]
    assert json.loads((tmp_path / "e.json").read_text())["settings"]["buildings"] == 2
    assert errors.main([*command, "--seed", "1"]) == 2


def test_the_cars_of_all_cases_are_admitted():
    for case in cases_of("people"):
        assert limits_for(Settings(v_max=case["v_max"])).v_max == case["v_max"]


def test_a_car_with_errors_does_not_wait_where_there_is_room():
    # The MPC's plans stand still here, but the car may drive on.
    given = {"jitter": 0.05, "lag": 0.1191, "pose_error": 0.0239, "dropout": 0.2}
    settings = Settings(
        world=("maze",),
        seed=990399,
        route="fixed",
        arms=("predicted",),
        v_max=6.0,
        vehicle="reeds-shepp",
        **given,
    )
    worst = WorstErrors("jumps", "from the wall", "late", "short", 0.9645)
    car = limits_for(settings)
    scenario = Scenario(399, "compact", "usual", (), settings, car=car, worst=worst)
    found = driven(scenario, scenario.task(), 6.0)
    assert found["outcome"] == "reached"
    assert not found["touched"]
