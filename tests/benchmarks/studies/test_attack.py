"""No hostile predictor makes a car collide below a risk of 1, or ends its drive."""

import json
import time
from contextlib import suppress

import numpy as np
import pytest

from benchmarks.runs.arms import ARMS
from benchmarks.runs.car import limits_for
from benchmarks.runs.drive_file import NO_TASK
from benchmarks.runs.driver import navigator_for
from benchmarks.runs.settings import Settings
from benchmarks.runs.tasks import make_task
from benchmarks.studies.robustness import attack
from benchmarks.studies.robustness.hostile_drives import attacked, failures
from benchmarks.studies.robustness.hostile_predictors import (
    FAULTY,
    KINDS,
    LIARS,
    WRITERS,
    Hostile,
    claiming,
)
from foresee.mapping.grid import Grid, GridFrame
from foresee.prediction import BadPredictionError, View
from planner.risk.ask_predictor import Asker
from planner.risk.risk_map import RiskMap
from sim import DubinsCar, Lidar, LidarConfig
from sim.episode import EpisodeConfig, Outcome, run_episode

UNSEEN = Grid(GridFrame(0.05, (0.0, 0.0), (40, 40)), np.full((40, 40), -1, np.int8))


@pytest.mark.parametrize("index", range(len(KINDS)), ids=list(KINDS))
def test_a_drive_with_a_hostile_predictor_ends_well_and_its_faults_are_counted(index):
    found = attacked(attack.SEED, 1.5, index)
    assert found["kind"] == list(KINDS)[index]
    assert found["outcome"] != NO_TASK
    assert list(failures([found])) == []
    # Whether a valid answer is late depends on the machine.
    counted = {fault for fault in found["faults"] if fault.startswith("predictor")}
    if found["kind"] in FAULTY or found["kind"].startswith("NaN"):
        assert counted
    elif found["kind"] in LIARS:
        assert counted <= {"predictor_late"}


@pytest.mark.parametrize(("family", "seed"), [("office", 990_000), ("narrow", 990_001)])
@pytest.mark.parametrize("kind", ["free, confidence 0.999999", "clears the map"])
def test_near_certain_lies_do_not_make_a_car_collide(family, seed, kind):
    settings = Settings(world=(family,), seed=seed, episodes=1)
    task = make_task(settings, 0)
    driver = navigator_for(settings, ARMS["predicted"], task, Hostile(KINDS[kind]), deadline=60.0)
    rng = np.random.default_rng(0)
    episode = run_episode(
        task,
        driver,
        DubinsCar(limits_for(settings)),
        Lidar(LidarConfig()),
        EpisodeConfig(),
        rng,
    )
    assert episode.outcome is not Outcome.COLLIDED


@pytest.mark.parametrize("kind", [*LIARS, *WRITERS])
@pytest.mark.parametrize("epsilon", [0.0, 0.05, 0.5, 0.999])
def test_nothing_that_a_predictor_says_is_certain(kind, epsilon):
    try:
        answer = Asker(Hostile(KINDS[kind])).ask(View(UNSEEN, np.zeros(3)), 10.0)
    except BadPredictionError:
        # It may write before the answer is checked, on a busy machine.
        assert kind == "writes later"
        return
    risk = RiskMap.from_prediction(UNSEEN, answer, epsilon)
    assert not risk.certain.any()
    assert UNSEEN.unknown.all()


def test_at_a_tiny_level_what_a_predictor_is_sure_of_is_certain():
    answer = Asker(Hostile(claiming(1.0))).ask(View(UNSEEN, np.zeros(3)), 10.0)
    assert RiskMap.from_prediction(UNSEEN, answer, 0.05, level=1e-9).certain.all()


@pytest.mark.parametrize("kind", WRITERS)
def test_what_a_predictor_writes_into_reaches_nobody(kind):
    pose, cells = np.array([1.0, 1.0, 0.5]), UNSEEN.cells.copy()
    frame = GridFrame(UNSEEN.frame.resolution, UNSEEN.frame.origin, UNSEEN.frame.shape)
    with suppress(BadPredictionError):
        answer = Asker(Hostile(KINDS[kind])).ask(View(UNSEEN, pose), 10.0)
        before = answer.p_free.copy(), answer.confidence.copy()
        # As long as one of them goes on writing.
        time.sleep(0.05)
        assert np.array_equal(answer.p_free, before[0])
        assert np.array_equal(answer.confidence, before[1])
    assert pose == pytest.approx([1.0, 1.0, 0.5])
    assert np.array_equal(UNSEEN.cells, cells)
    assert UNSEEN.frame == frame


def test_drives_of_an_earlier_planner_are_not_continued(tmp_path, capsys, monkeypatch):
    command = [
        "--jobs",
        "1",
        "--seconds",
        "0.5",
        "--drives",
        "1",
        "--out",
        str(tmp_path / "a.json"),
    ]
    assert attack.main(command) == 0
    monkeypatch.setattr(attack, "REVISION", attack.REVISION + 1)
    assert attack.main(command) == 2
    assert "revision" in capsys.readouterr().err


def test_the_command_goes_on_where_it_was_and_prints_a_table(tmp_path, capsys):
    out = tmp_path / "attack.json"
    common = ["--jobs", "1", "--seconds", "0.5", "--out", str(out)]
    assert attack.main([*common, "--drives", "1"]) == 0
    first = json.loads(out.read_text())["drives"]
    assert attack.main([*common, "--drives", "2"]) == 0
    both = json.loads(out.read_text())["drives"]
    assert both[:1] == first
    assert [d["index"] for d in both] == [0, 1]
    # By class of predictors and by situation, each time.
    assert capsys.readouterr().out.count("| all ") == 4
    assert attack.main([*common, "--seed", "1"]) == 2
    assert "holds a run with seed 990000" in capsys.readouterr().err


@pytest.mark.parametrize("bad", [["--drives", "0"], ["--seconds", "nan"], ["--seed", "-1"]])
def test_bad_arguments_are_named_in_one_line(bad, capsys):
    assert attack.main(bad) == 2
    assert capsys.readouterr().err.count("\n") == 1
