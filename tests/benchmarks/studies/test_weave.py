"""How fast the car drives on straights, and how much it weaves."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from drive_results import a_result

from benchmarks.runs.saved_run import Run
from benchmarks.studies.driver import weave

WAY = np.array([[20.0, 2.0], [20.0, 12.0]])
"""Along a straight of 18 m, round a corner, and up one of 10 m."""


def a_run(folder, curvature, route="fixed"):
    """A drive along the way at 2 m/s; its curvatures are as given for the first straight."""
    x = np.arange(2.0, 20.0, 0.2)
    states = np.column_stack([x, np.full_like(x, 2.0), np.zeros_like(x), np.full_like(x, 2.0)])
    controls = np.zeros((len(x) - 1, 2))
    controls[: len(curvature), 1] = curvature
    folder.mkdir()
    np.savez_compressed(
        folder / "traces.npz",
        **{
            "e0/known/states": states,
            "e0/known/controls": controls,
            "w0/waypoints": WAY,
        },
    )
    episode = asdict(a_result(start=states[0, :3].tolist(), goal=[20.0, 12.0]))
    results = {"settings": {"route": route}, "summary": {}, "episodes": [episode]}
    (folder / "results.json").write_text(json.dumps(results))
    return folder


def test_changes_of_sign_on_the_straight_are_counted_and_none_in_the_corner(tmp_path, capsys):
    curvature = np.zeros(88)
    curvature[[10, 20, 30]] = 0.02, -0.02, 0.06
    # In the corner, where the way turns.
    curvature[[84, 86]] = -0.5, 0.5
    out = tmp_path / "weave.json"
    assert weave.main([str(a_run(tmp_path / "run", curvature)), "--out", str(out)]) == 0
    results = json.loads(out.read_text())
    found = results["runs"][0]["arms"]["known"]
    assert found["changes"] == [2, 0]
    assert 14.0 < found["metres"] < 16.0
    assert found["speed"] == 2.0
    assert weave.table(results) in capsys.readouterr().out


def test_drives_that_a_run_lacks_are_left_out(tmp_path):
    folder = a_run(tmp_path / "run", [])
    results = json.loads((folder / "results.json").read_text())
    lone = results["episodes"][0] | {"index": 1, "arm": "backup"}
    results["episodes"].append(lone)
    with np.load(folder / "traces.npz") as packed:
        traces = dict(packed)
    names = {"states": "e1/backup/states", "controls": "e1/backup/controls"}
    more = {of: traces[f"e0/known/{name}"] for name, of in names.items()}
    more["w1/waypoints"] = WAY
    np.savez_compressed(folder / "traces.npz", **traces, **more)
    (folder / "results.json").write_text(json.dumps(results))
    arms = weave.counts(Run.load(folder))["arms"]
    assert arms["known"] == arms["backup"]


def test_an_arm_without_a_straight_has_a_dash():
    arms = {"known": {"metres": 0.0, "speed": None, "changes": [0]}}
    text = weave.table({"runs": [{"label": "run", "thresholds": [0.01], "arms": arms}]})
    assert [line.count("–") for line in text.splitlines()[-2:]] == [1, 1]


@pytest.mark.parametrize(
    ("curvature", "count"),
    [
        ([0.1, 0.1, 0.1], 0),
        ([0.1, -0.1, 0.1], 2),
        ([0.1, 0.001, -0.1], 1),
        ([0.1, -0.001, 0.1], 0),
        ([], 0),
    ],
)
def test_small_curvatures_do_not_count(curvature, count):
    assert weave.sign_changes(np.array(curvature), 0.01) == count


def test_stretches_are_runs_of_true_values():
    assert weave.stretches(np.array([True, False, True, True])) == [(0, 1), (2, 4)]
    assert weave.stretches(np.zeros(3, bool)) == []


def test_drives_of_chosen_ways_are_refused_in_a_line(tmp_path, capsys):
    run = a_run(tmp_path / "run", [], route="free")
    assert weave.main([str(run), "--out", str(tmp_path / "weave.json")]) == 2
    assert "--route fixed" in capsys.readouterr().err
