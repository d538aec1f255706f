"""The main job's command line: what it writes, that it goes on, and how it refuses."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drive_results import a_result

from benchmarks import tables
from benchmarks.corridor import main
from benchmarks.runs.drive import attempt, drive, score
from benchmarks.runs.settings import Settings
from benchmarks.runs.store import Store
from predictor import PredictorError
from predictor.infra import resumable
from predictor.infra.workers import LostError
from predictor.mapping.car_limits import CarLimits
from sim import empty_straight, save_world
from sim.map_server import MapError

SUMMARY = {"episodes", "reached", "collided", "timed_out", "stuck", "mean_speed", "time_to_goal",
           "max_speed", "min_clearance", "stops", "cycle_ms_p50", "cycle_ms_p99", "sct", "detour",
           "t_bound", "t_opt", "over_optimum", "vehicle"}  # fmt: skip
EPISODE = {"arm", "world", "seed", "start", "goal", "outcome", "time", "path_length",
           "mean_speed", "max_speed", "min_clearance", "stops", "shortest", "shortest_length",
           "t_bound", "t_opt", "sct", "detour", "vehicle"}  # fmt: skip
OUTCOMES = {"reached", "collided", "timed_out", "stuck"}


def run(*words) -> int:
    """The exit status of a command line."""
    try:
        return main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)


def python(*words, cwd):
    return subprocess.run(
        [sys.executable, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=120,
        check=False,
    )  # fmt: skip


def results(out):
    return json.loads((out / "results.json").read_text())


def untimed(episodes):
    """Episodes without what depends on the clock."""
    return [{k: v for k, v in e.items() if k != "cycle_ms"} for e in episodes]


def assert_same_drives(a, b):
    """Two runs have the same episodes and traces, but for what depends on the clock."""
    assert untimed(results(a)["episodes"]) == untimed(results(b)["episodes"])
    with np.load(a / "traces.npz") as one, np.load(b / "traces.npz") as other:
        assert set(one.files) == set(other.files)
        for name in one.files:
            if not name.endswith("/times"):
                assert np.array_equal(one[name], other[name]), name


@pytest.fixture(scope="module")
def short_map(tmp_path_factory):
    """A straight of 20 m as a map_server file."""
    path = tmp_path_factory.mktemp("map") / "straight.yaml"
    save_world(empty_straight(20.0, 3.0), path)
    return path


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """A run of one drive through a narrow building: its folder, and its command."""
    out = tmp_path_factory.mktemp("narrow") / "run"
    command = ("--episodes", 1, "--arms", "known", "--world", "narrow", "--seed", 3,
               "--jobs", 1, "--out", out)  # fmt: skip
    assert run(*command) == 0
    return out, command


def test_the_results_have_what_the_issue_names(narrow):
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
    assert r["settings"]["risk"] == 0.05
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


def test_a_full_disk_gives_one_line_and_what_was_done_is_kept(
    short_map, tmp_path, monkeypatch, capsys
):
    command = ("--world", short_map, "--episodes", 2, "--jobs", 1, "--predictor", "none", "--arms",
               "known", "--out", tmp_path / "run")  # fmt: skip
    plain, written = resumable.write_whole, []

    def full(path, data):
        if written.count(".npz") == 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(path.suffix)
        plain(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(resumable, "write_whole", full)
        assert run(*command) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert "No space left on device; what was finished is kept" in said
    assert [path.name for path in (tmp_path / "run" / "parts").glob("*.npz")] == ["0-known.npz"]
    assert run(*command) == 0
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0, 1]


def test_one_map_driven_twice_gives_no_interval_and_no_word_of_the_gap(short_map, tmp_path, capsys):
    assert run("--world", short_map, "--episodes", 2, "--jobs", 1, "--predictor", "none",
               "--out", tmp_path / "run") == 0  # fmt: skip
    said = capsys.readouterr().out
    assert "Share of the gap" not in said
    rows = {line.split("|")[1].strip(): line for line in said.splitlines() if line[:1] == "|"}
    assert list(rows)[2:4] == [
        "**SCT** (95 % over worlds)",
        "**time ratio** to `known`, both reached",
    ]
    for row, arms in (("**SCT** (95 % over worlds)", 3), ("faster than `known` [m/s]", 2),
                      ("**time ratio** to `known`, both reached", 2),
                      ("speed [m/s] (95 % over worlds)", 3)):  # fmt: skip
        assert rows[row].count("(–)") == arms, rows[row]
        assert " to " not in rows[row].split("|", 2)[2]
    r = results(tmp_path / "run")
    entry = r["summary"]["predicted"]
    for name in ("sct_interval", "mean_speed_interval", "collided_interval"):
        assert entry[name] is None
    for name in ("time_ratio", "faster_than_known"):
        assert entry[name]["value"] is not None
        assert (entry[name]["low"], entry[name]["high"]) == (None, None)
    assert r["gap"] == {"sct": None, "time": None}


def optima_of(episodes, path, v_max=4.0, t_opt=10.0):
    """A file of T_opt, the same for all tasks."""
    found = [{"index": e["index"], "world": e["world"], "seed": e["seed"], "start": e["start"],
              "goal": e["goal"], "t_opt": t_opt, "t_bound": e["t_bound"]}
             for e in episodes]  # fmt: skip
    head = {"kind": "optimum", "settings": {"v_max": v_max}, "drives": found}
    path.write_text(json.dumps(head))
    return path


def test_times_are_compared_with_the_optimum_of_their_task(short_map, tmp_path, capsys):
    command = ("--world", short_map, "--episodes", 2, "--jobs", 1, "--arms", "known",
               "--out", tmp_path / "run")  # fmt: skip
    assert run(*command) == 0
    assert "T_opt" not in capsys.readouterr().out
    episodes = results(tmp_path / "run")["episodes"]
    optimum = optima_of(episodes[:1], tmp_path / "optimum.json")
    assert run(*command, "--optimum", optimum) == 0
    expected = episodes[0]["time"] / 10.0
    row = next(line for line in capsys.readouterr().out.splitlines() if "T_opt" in line)
    assert f" {expected:.2f} " in row
    for words in (("--optimum", optimum), ()):  # What is known is kept.
        assert run(*command, *words) == 0
        r = results(tmp_path / "run")
        assert [e["t_opt"] for e in r["episodes"]] == [10.0, None]
        assert r["summary"]["known"]["over_optimum"] == pytest.approx(expected)
        assert r["summary"]["known"]["t_opt"] == 10.0


def test_times_of_another_car_are_no_optimum(narrow, tmp_path, capsys):
    other = optima_of(results(narrow[0])["episodes"], tmp_path / "other.json", v_max=3.0)
    for words in (("--optimum", other), ("--optimum", tmp_path / "gone.json"),
                  ("--optimum", other, "--v-max", 3, "--vehicle", "reeds-shepp")):  # fmt: skip
        assert run(*words, "--out", tmp_path / "run") == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not (tmp_path / "run").exists()


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


def test_the_same_command_again_drives_nothing_more(narrow, monkeypatch):
    out, command = narrow
    before = results(out)["episodes"]

    def refuse(*_):
        pytest.fail("it drove again")

    monkeypatch.setattr("benchmarks.runs.drive.attempt", refuse)
    assert run(*command) == 0
    assert results(out)["episodes"] == before


def test_an_interrupted_run_goes_on_from_where_it_was(short_map, tmp_path, monkeypatch, capsys):
    common = ("--world", short_map, "--arms", "known", "--episodes", 2, "--jobs", 1)
    command = (*common, "--out", tmp_path / "run")
    plain, driven = attempt, []

    def interrupted(settings, weights, item):
        if item[0] == 1:
            raise KeyboardInterrupt
        return plain(settings, weights, item)

    def counted(settings, weights, item):
        driven.append(item[0])
        return plain(settings, weights, item)

    monkeypatch.setattr("benchmarks.runs.drive.attempt", interrupted)
    assert run(*command) != 0
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0]
    assert "interrupted" in capsys.readouterr().out
    monkeypatch.setattr("benchmarks.runs.drive.attempt", counted)
    assert run(*command) == 0
    assert driven == [1]
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0, 1]
    assert run(*common, "--out", tmp_path / "whole") == 0
    assert_same_drives(tmp_path / "run", tmp_path / "whole")


def test_a_drive_that_kills_who_drives_it_stops_no_other(short_map, tmp_path, monkeypatch, capsys):
    command = ("--world", short_map, "--arms", "known", "--episodes", 2, "--jobs", 1,
               "--out", tmp_path / "run")  # fmt: skip

    def deadly(work, todo, *_):
        yield todo[0], work(todo[0])
        raise LostError(todo[1:])

    with monkeypatch.context() as patched:
        patched.setattr("predictor.infra.workers.finished", deadly)
        assert run(*command) == 1
    assert "again and again: (1, 'known')" in capsys.readouterr().err
    r = results(tmp_path / "run")
    assert (r["lost"], r["summary"]["known"]["episodes"]) == ([[1, "known"]], 1)
    assert run(*command) == 0
    r = results(tmp_path / "run")
    assert (r["lost"], r["summary"]["known"]["episodes"]) == ([], 2)


@pytest.mark.parametrize("error", [PredictorError, MapError])
def test_what_a_worker_cannot_load_is_a_line_and_loses_nothing(
    error, short_map, tmp_path, monkeypatch, capsys
):
    command = ("--world", short_map, "--arms", "known", "--episodes", 2, "--jobs", 1,
               "--out", tmp_path / "run")  # fmt: skip

    def failing(settings, weights, item):
        if item[0] == 1:
            raise error("it has gone")
        return a_result(), {}

    monkeypatch.setattr("benchmarks.runs.drive.attempt", failing)
    assert run(*command) == 2
    said = capsys.readouterr().err
    assert said.splitlines()[-1] == "benchmarks.corridor: it has gone; what was finished is kept"
    assert "Traceback" not in said
    assert (tmp_path / "run/parts/0-known.npz").exists()


def test_a_second_interrupt_while_packing_is_a_line(short_map, tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.runs.drive.attempt", interrupted)
    monkeypatch.setattr("benchmarks.runs.store.Store.pack", interrupted)
    assert run("--world", short_map, "--jobs", 1, "--out", tmp_path / "run") == 130
    assert capsys.readouterr().err.splitlines()[-1].startswith("benchmarks.corridor: interrupted")


def test_an_episode_is_that_of_its_seed_with_noise_too():
    common = {"world": ("corridor",), "noise": 0.03, "dropout": 0.1}
    second, a = drive(Settings(**common, seed=0), 1, "known")
    first, b = drive(Settings(**common, seed=1), 0, "known")
    assert replace(second, index=0, cycle_ms=[]) == replace(first, cycle_ms=[])
    assert np.array_equal(a["e1/known/states"], b["e0/known/states"])


def test_baselines_are_not_driven_again_for_another_predictor(short_map, tmp_path, monkeypatch):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1)
    first, second = tmp_path / "first", tmp_path / "second"
    arms = "known,predicted,oracle"
    assert run(*command, "--arms", arms, "--predictor", "none", "--out", first) == 0
    plain, driven = attempt, []

    def counted(settings, weights, item):
        driven.append(item)
        return plain(settings, weights, item)

    monkeypatch.setattr("benchmarks.runs.drive.attempt", counted)
    assert run(*command, "--arms", arms, "--predictor", "extend", "--baselines", first,
               "--out", second) == 0  # fmt: skip
    assert driven == [(0, "predicted")]
    before, after = (results(out)["episodes"] for out in (first, second))
    assert [e["arm"] for e in after] == ["known", "predicted", "oracle"]
    assert (after[0], after[2]) == (before[0], before[2])
    with np.load(first / "traces.npz") as a, np.load(second / "traces.npz") as b:
        assert np.array_equal(a["e0/oracle/states"], b["e0/oracle/states"])


def test_baselines_of_another_risk_serve_the_arms_that_have_their_own(short_map, tmp_path, capsys):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1, "--predictor", "none")
    first, second = tmp_path / "first", tmp_path / "second"
    assert run(*command, "--arms", "known,oracle", "--out", first) == 0
    for arms, why in (("oracle", "holds a run with risk 0.05"), ("predicted", "chosen predictor")):
        assert run(*command, "--arms", arms, "--risk", 0.2, "--baselines", first,
                   "--out", second) == 2  # fmt: skip
        assert why in capsys.readouterr().err
        assert not second.exists()
    assert run(*command, "--arms", "known,oracle", "--risk", 0.2, "--expansion", 1.5,
               "--baselines", first, "--out", second) == 0  # fmt: skip
    before, after = (results(out)["episodes"] for out in (first, second))
    assert after[0] == before[0]
    assert after[1] != before[1]


def test_baselines_of_another_comparison_are_refused(narrow, tmp_path, capsys):
    out, _ = narrow
    for words, why in (
        (("--baselines", out), "holds a run with world"),
        (("--baselines", tmp_path / "gone"), "is not a folder"),
    ):
        assert run("--world", "office", *words, "--out", tmp_path / "run") == 2
        error = capsys.readouterr().err
        assert why in error
        assert error.count("\n") == 1
        assert not (tmp_path / "run").exists()


def test_vehicles_are_never_mixed(short_map, tmp_path, capsys):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1, "--arms", "known")
    first, second = tmp_path / "first", tmp_path / "second"
    assert run(*command, "--out", first) == 0
    assert results(first)["settings"]["vehicle"] == "dubins"
    assert [e["vehicle"] for e in results(first)["episodes"]] == ["dubins"]
    other = (*command, "--vehicle", "reeds-shepp")
    for words in (("--out", first), ("--baselines", first, "--out", second)):
        capsys.readouterr()
        assert run(*other, *words) == 2
        error = capsys.readouterr().err
        assert "holds a run with vehicle dubins" in error
        assert error.count("\n") == 1
    assert run(*other, "--out", second) == 0
    assert results(second)["settings"]["vehicle"] == "reeds-shepp"
    assert [e["vehicle"] for e in results(second)["episodes"]] == ["reeds-shepp"]


def test_an_older_run_goes_on_as_one_of_the_forward_only_car(short_map, tmp_path):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1, "--arms", "known")
    first, second = tmp_path / "first", tmp_path / "second"
    assert run(*command, "--out", first) == 0
    now = results(first)
    del now["settings"]["vehicle"], now["episodes"][0]["vehicle"]
    (first / "results.json").write_text(json.dumps(now))
    (first / "settings.json").write_text(json.dumps(now["settings"]))
    assert run(*command, "--vehicle", "reeds-shepp", "--out", first) == 2
    assert run(*command, "--out", first) == 0
    assert run(*command, "--baselines", first, "--out", second) == 0
    for out in (first, second):
        assert [e["vehicle"] for e in results(out)["episodes"]] == ["dubins"]


@pytest.mark.slow
def test_one_job_two_and_a_cluster_with_a_death_give_the_same_numbers(
    short_map, tmp_path, monkeypatch
):
    distributed = pytest.importorskip("distributed")
    command = ("--world", short_map, "--episodes", 2, "--arms", "known,predicted")
    for jobs in (1, 2):
        assert run(*command, "--jobs", jobs, "--out", tmp_path / str(jobs)) == 0
    plain, killed = Store.add, []

    def add(store, *drive):
        plain(store, *drive)
        if not killed:
            busy = next(w.name for w in cluster.scheduler.workers.values() if w.processing)
            killed.append(cluster.workers[busy].pid)
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(Store, "add", add)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                                  local_directory=tmp_path / "workers") as cluster:  # fmt: skip
        address = cluster.scheduler_address
        assert run(*command, "--dask", address, "--out", tmp_path / "dask") == 0
    assert killed
    assert [e["arm"] for e in results(tmp_path / "1")["episodes"]] == 2 * ["known", "predicted"]
    for other in ("2", "dask"):
        assert_same_drives(tmp_path / other, tmp_path / "1")


@pytest.mark.parametrize(
    "words",
    [("--arms", "known,telepathic"), ("--arms", ""), ("--arms", "known,known"),
     ("--risk", "2"), ("--risk", "nan"), ("--risk", "-0.1"), ("--risk", "much"),
     ("--world", "missing.yaml"), ("--world", "castle"), ("--predictor", "crystal_ball"),
     ("--predictor", "no_such_module:Class"), ("--predictor", "json:NoSuchClass"),
     ("--predictor", "json:dumps"), ("--episodes", "0"), ("--episodes", "-3"),
     ("--v-max", "0"), ("--v-max", "inf"), ("--window", "0"), ("--expansion", "0.5"),
     ("--jobs", "0"), ("--route", "scenic"), ("--noise", "-1"), ("--dropout", "1"),
     ("--seed", "-1"), ("--seed", "1.5"), ("--vehicle", "tank"), ("--faster",), ("--world",)],
    ids="".join,
)  # fmt: skip
def test_bad_arguments_exit_with_two_and_one_line(words, tmp_path, capsys):
    assert run(*words, "--out", tmp_path / "run") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.endswith("\n")
    assert captured.err.count("\n") == 1, captured.err
    assert "Traceback" not in captured.err
    assert not (tmp_path / "run").exists()


def broken_maps(folder):
    (folder / "empty.yaml").write_text("")
    (folder / "image_missing.yaml").write_text(
        "image: gone.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (folder / "not_yaml.yaml").write_text("{[")
    (folder / "no_maps").mkdir()


@pytest.mark.parametrize(
    "name", ["empty.yaml", "image_missing.yaml", "not_yaml.yaml", "no_maps"]
)  # fmt: skip
def test_broken_maps_exit_with_two_and_one_line(name, tmp_path, capsys):
    broken_maps(tmp_path)
    assert run("--world", tmp_path / name, "--out", tmp_path / "run") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_folder_of_another_run_is_refused_in_one_line_and_left_alone(narrow, capsys):
    out, command = narrow
    before = (out / "results.json").read_bytes()
    assert run(*command, "--risk", 0.5) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "risk 0.05" in error
    assert (out / "results.json").read_bytes() == before


@pytest.mark.parametrize("where", ["settings.json", "results.json"])
@pytest.mark.parametrize("content", ["{", "[]", "null", '{"episodes": 1}'])
def test_a_run_that_cannot_be_read_is_refused_in_one_line(where, content, tmp_path, capsys):
    out = tmp_path / "run"
    out.mkdir()
    (out / where).write_text(content)
    assert run("--world", "corridor", "--episodes", 1, "--out", out) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_an_out_that_is_a_file_is_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert run("--out", tmp_path / "file") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_tables_of_a_run_are_markdown(narrow, tmp_path, capsys):
    out, _ = narrow
    assert tables.main([str(out / "results.json")]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert "`known`" in lines[0]
    assert len({line.count("|") for line in lines}) == 1
    assert len({len(line) for line in lines}) == 1
    entry = results(out)["summary"]["known"]
    assert "SCT" in lines[2]
    assert f"{entry['sct']:.3f}" in lines[2]
    assert any("speed [m/s]" in line and f"{entry['mean_speed']:.2f}" in line for line in lines)
    (tmp_path / "foreign.json").write_text("[1, 2]")
    for name in ("foreign.json", "missing.json"):
        assert tables.main([str(tmp_path / name)]) == 2
        assert name in capsys.readouterr().err


def test_the_tables_of_older_results_have_what_can_be_said_of_them(capsys):
    folder = Path(__file__).parents[1] / "docs/results"
    files = [folder / f"{name}.json" for name in ("corridor-5m", "corridor-fixed-5m")]
    older = json.loads(files[0].read_text())
    for episode in older["episodes"]:
        for name in ("sct", "t_bound", "t_opt", "detour", "shortest_length", "vehicle"):
            episode.pop(name, None)
    older["settings"].pop("vehicle", None)
    text = tables.tables_of(tables.summarised(older))
    assert "dubins car" in text
    ratio = next(line for line in text.splitlines() if "time ratio" in line)
    assert re.search(r"0\.\d\d \(0\.\d\d to \d\.\d\d\)", ratio)
    sct = next(line for line in text.splitlines() if "SCT" in line)
    assert not "".join(sct.split("|")[2:]).strip()
    assert tables.main([str(path) for path in files]) == 0
    assert "## Overview" in capsys.readouterr().out


def test_the_tables_of_runs_have_the_risk_asked_for_beside_what_became_of_it(capsys):
    files = sorted((Path(__file__).parents[1] / "docs/results/risk").glob("corridor-*.json"))
    assert len(files) > 1
    assert tables.main([str(path) for path in files]) == 0
    text = capsys.readouterr().out
    rows = [line.split("|") for line in text.split("## Risks")[1].split("##")[0].splitlines()[4:]]
    rows = [[cell.strip() for cell in row] for row in rows if len(row) > 1]
    assert [row[1] for row in rows] == [path.stem for path in files]
    for row, path in zip(rows, files, strict=True):
        assert float(row[4]) == json.loads(path.read_text())["settings"]["risk"]
        value, low, high = re.fullmatch(r"(.+) % \((.+)–(.+)\)", row[5]).groups()
        assert float(low) < float(value) < float(high)


PLUG_IN = '''
import numpy as np

from predictor import Prediction


class MyPredictor:
    """Believes that everything goes on being free, a little."""

    def predict(self, known, pose):
        free = known.free.astype(np.float32)
        free[known.unknown] = 0.6
        return Prediction(
            frame=known.frame,
            p_free=free,
            p_occupied=known.occupied.astype(np.float32),
            confidence=np.ones(known.frame.shape, np.float32),
        )
'''


def test_a_plug_in_in_a_file_of_ones_own_runs_from_any_folder(short_map, tmp_path):
    (tmp_path / "my_module.py").write_text(PLUG_IN)
    done = python("-m", "benchmarks.corridor", "--predictor", "my_module:MyPredictor",
                  "--world", short_map, "--arms", "predicted", "--risk", 0.5, "--episodes", 2,
                  "--jobs", 2, "--out", "run", cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    r = results(tmp_path / "run")
    assert r["settings"]["predictor"] == "my_module:MyPredictor"
    assert len(r["episodes"]) == 2
    for episode in r["episodes"]:
        assert not any(kind.startswith("predictor") for kind in episode["faults"])
        assert episode["promises"] > 0


STUDENT = '''
from predictor import NoPrediction
from predictor.mapping.grid import world_hash
from sim.map_server import load_world
from sim.world import sealed


class Student(NoPrediction):
    """Has learned from the very building that it is asked about."""

    def __init__(self):
        cells = sealed(load_world({path!r})).grid.cells
        self.facts = {{"worlds": [world_hash(cells)], "fingerprint": {fingerprint!r}}}
'''


def test_buildings_learned_from_and_other_weights_are_noticed(short_map, tmp_path):
    def go(fingerprint):
        text = STUDENT.format(path=str(short_map), fingerprint=fingerprint)
        (tmp_path / "school.py").write_text(text)
        return python("-m", "benchmarks.corridor", "--predictor", "school:Student", "--world",
                      short_map, "--arms", "known,predicted", "--episodes", 1, "--jobs", 1,
                      "--out", "run", cwd=tmp_path)  # fmt: skip

    first = go("one")
    assert first.returncode == 0, first.stderr
    assert "has learned from the buildings of 1 episode" in first.stdout
    learned = {e["arm"]: e["learned"] for e in results(tmp_path / "run")["episodes"]}
    assert learned == {"known": False, "predicted": True}
    second = go("two")
    assert second.returncode == 2
    assert "weights one" in second.stderr


def test_help_names_the_units(tmp_path):
    done = python("-m", "benchmarks.corridor", "--help", cwd=tmp_path)
    assert done.returncode == 0
    for word in ("[m/s]", "[m]", "--world", "--route", "--episodes", "--seed", "--arms",
                 "--predictor", "--risk", "--v-max", "--window", "--expansion", "--jobs",
                 "--out"):  # fmt: skip
        assert word in done.stdout
