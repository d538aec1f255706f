"""What a comparison takes from other runs: baselines, optima, and runs of older versions."""

import json

import numpy as np
import pytest
from comparison import results, run

from benchmarks.runs.drive import attempt_arm
from benchmarks.tables import file_tables
from foresee.infra.results_file import read_results


def optima_of(episodes, path, v_max=4.0, t_opt=10.0):
    """A file of T_opt, the same for all tasks."""
    found = [
        {
            "index": e["index"],
            "world": e["world"],
            "seed": e["seed"],
            "start": e["start"],
            "goal": e["goal"],
            "t_opt": t_opt,
            "t_bound": e["t_bound"],
        }
        for e in episodes
    ]
    head = {"kind": "optimum", "settings": {"v_max": v_max, "braking": 1.5}, "drives": found}
    path.write_text(json.dumps(head))
    return path


def test_times_are_compared_with_the_optimum_of_their_task(short_map, tmp_path):
    command = (
        "--world",
        short_map,
        "--episodes",
        2,
        "--jobs",
        1,
        "--arms",
        "known",
        "--out",
        tmp_path / "run",
    )
    file = tmp_path / "run/results.json"
    assert run(*command) == 0
    assert "T_opt" not in file_tables(read_results(file))
    episodes = results(tmp_path / "run")["episodes"]
    optimum = optima_of(episodes[:1], tmp_path / "optimum.json")
    assert run(*command, "--optimum", optimum) == 0
    expected = episodes[0]["time"] / 10.0
    lines = file_tables(read_results(file)).splitlines()
    row = next(line for line in lines if "T_opt" in line)
    assert f" {expected:.2f} " in row
    for words in (("--optimum", optimum), ()):  # What is known is kept.
        assert run(*command, *words) == 0
        r = results(tmp_path / "run")
        assert [e["t_opt"] for e in r["episodes"]] == [10.0, None]
        assert r["summary"]["known"]["over_optimum"] == pytest.approx(expected)
        assert r["summary"]["known"]["t_opt"] == 10.0


def test_times_of_another_car_are_no_optimum(narrow, tmp_path, capsys):
    other = optima_of(results(narrow[0])["episodes"], tmp_path / "other.json", v_max=3.0)
    for words in (
        ("--optimum", other),
        ("--optimum", tmp_path / "gone.json"),
        ("--optimum", other, "--v-max", 3, "--vehicle", "reeds-shepp"),
    ):
        assert run(*words, "--out", tmp_path / "run") == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not (tmp_path / "run").exists()


@pytest.mark.slow(6)
def test_baselines_are_not_driven_again_for_another_predictor(short_map, tmp_path, monkeypatch):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1)
    first, second = tmp_path / "first", tmp_path / "second"
    arms = "known,predicted,oracle"
    assert run(*command, "--arms", arms, "--predictor", "none", "--out", first) == 0
    plain, driven = attempt_arm, []

    def counted(settings, weights, item, **_):
        driven.append(item)
        return plain(settings, weights, item)

    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", counted)
    assert (
        run(
            *command, "--arms", arms, "--predictor", "extend", "--baselines", first, "--out", second
        )
        == 0
    )
    assert driven == [(0, "predicted")]
    before, after = (results(out)["episodes"] for out in (first, second))
    assert [e["arm"] for e in after] == ["known", "predicted", "oracle"]
    assert (after[0], after[2]) == (before[0], before[2])
    with np.load(first / "traces.npz") as a, np.load(second / "traces.npz") as b:
        assert np.array_equal(a["e0/oracle/states"], b["e0/oracle/states"])


def test_baselines_of_another_reliance_serve_the_arms_that_have_their_own(
    short_map, tmp_path, capsys
):
    command = ("--world", short_map, "--episodes", 1, "--jobs", 1, "--predictor", "none")
    first, second = tmp_path / "first", tmp_path / "second"
    assert run(*command, "--arms", "known,oracle", "--out", first) == 0
    for arms, why in (
        ("oracle", "holds a run with reliance 0.3"),
        ("predicted", "chosen predictor"),
    ):
        assert (
            run(*command, "--arms", arms, "--reliance", 0.2, "--baselines", first, "--out", second)
            == 2
        )
        assert why in capsys.readouterr().err
        assert not second.exists()
    assert (
        run(
            *command,
            "--arms",
            "known,oracle",
            "--reliance",
            0.2,
            "--expansion",
            1.5,
            "--baselines",
            first,
            "--out",
            second,
        )
        == 0
    )
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
