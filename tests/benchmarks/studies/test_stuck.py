"""Why drives got stuck: when the goal could last be reached."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from drive_results import a_result

from benchmarks.runs.saved_run import Run
from benchmarks.studies.driver import stuck

TICKS = 80


def a_run(folder, goal, vehicle="dubins"):
    """A drive along a corridor, 2 m wide, past the only branch, to its dead end."""
    cells = np.full((140, 220), 100, np.int8)
    cells[10:30, 10:210] = 0
    cells[10:130, 90:130] = 0
    x = np.linspace(2.0, 20.0, TICKS + 1)
    states = np.column_stack([x, np.full_like(x, 2.0), np.zeros_like(x), np.full_like(x, 2.25)])
    states[-1, 3] = 0.0
    folder.mkdir()
    np.savez_compressed(
        folder / "traces.npz",
        **{"e0/known/states": states, "w0/cells": cells, "w0/frame": np.array([0.1, 0.0, 0.0])},
    )
    episode = asdict(a_result(start=states[0, :3].tolist(), goal=goal, outcome="stuck"))
    settings = {"dt": 0.1, "v_max": 4.0, "vehicle": vehicle}
    results = {"settings": settings, "summary": {}, "episodes": [episode]}
    (folder / "results.json").write_text(json.dumps(results))
    return folder


def test_the_last_way_out_lies_before_the_branch(tmp_path):
    run = Run.load(a_run(tmp_path / "run", [11.0, 12.0]))
    (one,) = stuck.causes(run)["stuck"]
    x = 20.0 - 18.0 / TICKS * one["seconds"] / 0.1
    # The branch is 4 m wide and begins at 9 m; the car turns on 0.8 m.
    assert 9.0 < x < 12.5
    assert one["speed"] == 2.25


def test_a_goal_ahead_could_still_be_reached(tmp_path, capsys):
    out = tmp_path / "stuck.json"
    assert stuck.main([str(a_run(tmp_path / "run", [20.4, 2.0])), "--out", str(out)]) == 0
    results = json.loads(out.read_text())
    assert results["runs"][0]["stuck"][0]["seconds"] == 0.0
    assert stuck.table(results) in capsys.readouterr().out


def test_a_goal_in_the_wall_is_out_of_reach_from_everywhere(tmp_path):
    run = Run.load(a_run(tmp_path / "run", [3.0, 8.0]))
    assert stuck.causes(run)["stuck"][0]["seconds"] is None


@pytest.mark.parametrize(("name", "says"), [("run", "reeds-shepp"), ("nothing", "not a folder")])
def test_what_cannot_be_searched_is_refused_in_a_line(tmp_path, capsys, name, says):
    a_run(tmp_path / "run", [3.0, 8.0], "reeds-shepp")
    out = tmp_path / "stuck.json"
    assert stuck.main([str(tmp_path / name), "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert says in said[-1]
    assert not out.exists()
