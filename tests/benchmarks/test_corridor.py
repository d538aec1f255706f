"""The main job: what its results hold."""

import json
from dataclasses import replace

import numpy as np
import pytest
from calibrations import written
from comparison import python, results, run

from benchmarks.runs.drive import drive, score
from benchmarks.runs.settings import Settings
from benchmarks.tables import file_tables
from foresee.infra.results_file import read_results
from foresee.mapping.car_limits import CarLimits
from planner.revision import FIRST, revision_of

SUMMARY = {
    "episodes",
    "reached",
    "collided",
    "timed_out",
    "stuck",
    "mean_speed",
    "time_to_goal",
    "max_speed",
    "min_clearance",
    "stops",
    "cycle_ms_p50",
    "cycle_ms_p99",
    "sct",
    "detour",
    "t_bound",
    "t_opt",
    "over_optimum",
    "vehicle",
}


EPISODE = {
    "arm",
    "world",
    "seed",
    "start",
    "goal",
    "outcome",
    "time",
    "path_length",
    "mean_speed",
    "max_speed",
    "min_clearance",
    "stops",
    "shortest",
    "shortest_length",
    "t_bound",
    "t_opt",
    "sct",
    "detour",
    "vehicle",
}


OUTCOMES = {"reached", "collided", "timed_out", "stuck"}


def test_the_results_have_the_documented_fields(narrow):
    out, _ = narrow
    r = results(out)
    assert {"settings", "machine", "version", "commit", "summary", "episodes"} <= r.keys()
    assert r["summary"].keys() == {"known"}
    assert r["summary"]["known"].keys() >= SUMMARY
    (episode,) = r["episodes"]
    assert episode.keys() >= EPISODE
    assert episode["outcome"] in OUTCOMES
    assert episode["outcome"] != "collided"
    assert r["settings"]["world"] == ["narrow"]
    assert r["settings"]["reliance"] == 0.3
    assert r["settings"]["vehicle"] == "dubins"
    json.loads((out / "results.json").read_text(), parse_constant=pytest.fail)


def test_the_summary_adds_up_to_the_episodes(narrow):
    r = results(narrow[0])
    entry, (episode,) = r["summary"]["known"], r["episodes"]
    assert entry["episodes"] == 1
    assert sum(entry[name] for name in OUTCOMES) == 1
    assert entry[episode["outcome"]] == 1
    assert entry["mean_speed"] == pytest.approx(episode["mean_speed"])
    assert episode["mean_speed"] == pytest.approx(episode["path_length"] / episode["time"])
    assert episode["mean_speed"] <= episode["max_speed"] <= r["settings"]["v_max"]


def test_a_drive_is_scored_by_the_shortest_way_of_its_task(narrow):
    (episode,) = results(narrow[0])["episodes"]
    assert 0.5 * episode["shortest"] < episode["shortest_length"] <= episode["shortest"] + 0.5
    # At the car's best: from rest to 4 m/s in 5.33 m, then at 4 m/s to half a metre from the goal.
    bound = 4.0 / 1.5 + (episode["shortest_length"] - 0.5 - 4.0**2 / (2 * 1.5)) / 4.0
    assert episode["t_bound"] == pytest.approx(bound)
    reached = episode["outcome"] == "reached"
    assert episode["sct"] == pytest.approx(bound / episode["time"] if reached else 0.0)
    assert episode["detour"] == pytest.approx(episode["path_length"] / episode["shortest_length"])


def test_a_drive_that_does_not_arrive_scores_nothing():
    car = CarLimits()
    scores = {outcome: score(outcome, 20.0, 60.0, 50.0, car) for outcome in OUTCOMES}
    assert {outcome for outcome, of in scores.items() if of["sct"] == 0.0} == OUTCOMES - {"reached"}
    assert scores["reached"]["sct"] == pytest.approx(scores["stuck"]["t_bound"] / 20.0)
    assert scores["stuck"]["detour"] == pytest.approx(1.2)
    assert set(score("reached", 20.0, 60.0, None, car).values()) == {None}


def test_one_map_driven_twice_gives_no_interval_and_no_word_of_the_gap(short_map, tmp_path):
    assert (
        run(
            "--world",
            short_map,
            "--episodes",
            2,
            "--jobs",
            1,
            "--predictor",
            "none",
            "--out",
            tmp_path / "run",
        )
        == 0
    )
    said = file_tables(read_results(tmp_path / "run/results.json"))
    assert "of the gap" not in said
    rows = {line.split("|")[1].strip(): line for line in said.splitlines() if line[:1] == "|"}
    assert list(rows)[2:4] == [
        "**SCT** (95 % over worlds)",
        "**time ratio** to `known`, both reached",
    ]
    for row, arms in (
        ("**SCT** (95 % over worlds)", 3),
        ("faster than `known` [m/s]", 2),
        ("**time ratio** to `known`, both reached", 2),
        ("speed [m/s] (95 % over worlds)", 3),
    ):
        assert rows[row].count("(–)") == arms, rows[row]
        assert " to " not in rows[row].split("|", 2)[2]
    r = results(tmp_path / "run")
    entry = r["summary"]["predicted"]
    for name in ("sct_interval", "mean_speed_interval", "collided_interval"):
        assert entry[name] is None
    for name in ("time_ratio", "faster_than_known"):
        assert entry[name]["value"] is not None
        assert (entry[name]["low"], entry[name]["high"]) == (None, None)
    assert r["gap"] == {"predicted": {"sct": None, "time": None}}


def test_each_risk_is_a_column_that_says_whether_it_is_certified(short_map, tmp_path, capsys):
    levels = {"0.02": 0.01, "0.05": 0.03}
    calibration = written(tmp_path / "c.json", certified=levels)
    out = tmp_path / "run"
    command = ["--world", short_map, "--episodes", 1, "--jobs", 1, "--predictor", "none"]
    command += ["--arms", "known,predicted", "--calibration", calibration, "--out", out]
    assert run(*command, "--risk", 0, 0.02) == 2
    assert "is for maps" in capsys.readouterr().err
    assert run(*command, "--risk", 0, 0.02, "--uncertified") == 0
    said = capsys.readouterr().out
    assert "| `known` " in said
    assert "| `predicted` " in said
    assert "| `predicted 2 %`, not certified " in said
    rows = [line for line in said.splitlines() if line.startswith("|")]
    assert len(rows) <= 2 + 8
    assert any("hard stops" in row for row in rows)
    assert said.splitlines()[-1].endswith("for intervals. No drive collided.")
    assert {e["arm"]: e["level"] for e in results(out)["episodes"]} == {
        "known": None,
        "predicted": 0.0,
        "predicted 2 %": 0.01,
    }
    # A further risk is a further column of the same run; the other drives stay.
    before = results(out)["episodes"]
    assert run(*command, "--risk", 0, 0.02, 0.05, "--uncertified") == 0
    assert "| `predicted 5 %`, not certified " in capsys.readouterr().out
    assert results(out)["episodes"][:3] == before
    written(calibration, certified={"0.02": 0.02})
    assert run(*command, "--risk", 0, 0.02, "--uncertified") == 2
    assert "drives of predicted 2 % at level 0.01, not 0.02" in capsys.readouterr().err


def test_the_figures_and_traces_are_there(narrow):
    out, _ = narrow
    for name in ("speed_profile.png", "trajectories.png", "moment.png"):
        assert (out / name).stat().st_size > 5_000
    (episode,) = results(out)["episodes"]
    with np.load(out / "traces.npz", allow_pickle=False) as traces:
        states = traces["e0/known/states"]
    assert len(states) == episode["ticks"] + 1
    length = np.hypot(*np.diff(states[:, :2], axis=0).T).sum()
    assert length == pytest.approx(episode["path_length"])


def test_an_episode_is_that_of_its_seed_with_noise_too():
    common = {"world": ("corridor",), "noise": 0.03, "dropout": 0.1}
    second, a = drive(Settings(**common, seed=35), 1, "known")
    first, b = drive(Settings(**common, seed=36), 0, "known")
    assert replace(second, index=0, cycle_ms=[]) == replace(first, cycle_ms=[])
    assert np.array_equal(a.states, b.states)


@pytest.mark.parametrize(
    ("arm", "risk", "earlier"),
    [("predicted", 0.05, True), ("known", 0.05, False), ("predicted", 0.0, False)],
)
def test_a_drive_knows_whether_its_calibration_is_of_an_earlier_planner(
    arm, risk, earlier, short_map
):
    settings = Settings(world=(str(short_map),), predictor="none", risk=risk, calibrated=FIRST)
    result = drive(settings, 0, arm).result
    assert result.revision == revision_of(settings.route)
    assert result.earlier_calibration == earlier


def test_help_names_the_units(tmp_path):
    done = python("-m", "benchmarks.corridor", "--help", cwd=tmp_path)
    assert done.returncode == 0
    for word in (
        "[m/s]",
        "[m]",
        "--world",
        "--route",
        "--episodes",
        "--seed",
        "--arms",
        "--predictor",
        "--risk",
        "--level",
        "--reliance",
        "--v-max",
        "--window",
        "--expansion",
        "--jobs",
        "--out",
    ):
        assert word in done.stdout
