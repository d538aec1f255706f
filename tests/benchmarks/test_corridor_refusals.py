"""Bad arguments and bad input of a comparison: status 2 and one line."""

import importlib
import os
import re

import pytest
from comparison import run

from sim import empty_straight, save_world


@pytest.mark.parametrize(
    "words",
    [
        ("--arms", "known,telepathic"),
        ("--arms", ""),
        ("--arms", "known,known"),
        ("--risk", "2"),
        ("--risk", "nan"),
        ("--risk", "-0.1"),
        ("--risk", "much"),
        ("--world", "missing.yaml"),
        ("--world", "castle"),
        ("--predictor", "crystal_ball"),
        ("--predictor", "no_such_module:Class"),
        ("--predictor", "json:NoSuchClass"),
        ("--predictor", "json:dumps"),
        ("--episodes", "0"),
        ("--episodes", "-3"),
        ("--v-max", "0"),
        ("--v-max", "inf"),
        ("--v-max", "10", "--braking", "0.3"),
        ("--window", "0"),
        ("--expansion", "0.5"),
        ("--jobs", "0"),
        ("--route", "scenic"),
        ("--noise", "-1"),
        ("--dropout", "1"),
        ("--dask", "foo"),
        ("--seed", "-1"),
        ("--seed", "1.5"),
        ("--vehicle", "tank"),
        ("--faster",),
        ("--world",),
    ],
    ids="".join,
)
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


@pytest.mark.parametrize("name", ["empty.yaml", "image_missing.yaml", "not_yaml.yaml", "no_maps"])
def test_broken_maps_exit_with_two_and_one_line(name, tmp_path, capsys):
    broken_maps(tmp_path)
    assert run("--world", tmp_path / name, "--out", tmp_path / "run") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_maps_of_the_same_name_are_refused_in_one_line(tmp_path, capsys):
    for floor in ("ground", "first"):
        (tmp_path / floor).mkdir()
        save_world(empty_straight(20.0, 3.0), tmp_path / floor / "map.yaml")
    floors = [str(tmp_path / floor) for floor in ("ground", "first")]
    assert run("--world", *floors, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "have the same name" in said
    assert said.count("\n") == 1


def test_a_folder_of_another_run_is_refused_in_one_line_and_left_alone(narrow, capsys):
    out, command = narrow
    before = (out / "results.json").read_bytes()
    assert run(*command, "--reliance", 0.5) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "reliance 0.3" in error
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


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("", "empty"),
        ("a\0b", "NUL"),
        ("x" * 300, "File name too long"),
        ("taken", "File exists"),
        ("taken/inside", "Not a directory"),
        ("pipe", "File exists"),
        ("/dev/null", "File exists"),
        ("/proc/nowhere", "No such file"),
    ],
    ids=["empty", "NUL", "long", "file", "in a file", "pipe", "device", "no place"],
)
@pytest.mark.parametrize("command", ["corridor", "calibrate", "evaluate", "drives", "optimum"])
def test_a_place_that_cannot_be_written_is_refused_in_one_line(
    command, place, why, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("precious")
    os.mkfifo(tmp_path / "pipe")
    if command == "optimum" and place in ("taken", "pipe", "/dev/null", "taken/inside"):
        why = "no results file|File exists"
    module = "predictor" if command in ("evaluate", "drives") else "benchmarks"
    main = importlib.import_module(f"{module}.{command}").main
    assert main(["--jobs", "1", "--out", place]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert re.search(why, captured.err)
    assert "Traceback" not in captured.err
    assert {path.name for path in tmp_path.iterdir()} == {"taken", "pipe"}
    assert (tmp_path / "taken").read_text() == "precious"
