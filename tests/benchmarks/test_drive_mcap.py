"""A saved drive as an MCAP file: what was not saved is made again, and checked."""

import json
import math
import shutil

import numpy as np
import pytest
from comparison import run as compare

from benchmarks import plot
from benchmarks.runs.saved_run import Run
from predictor.data.bags import read_bag

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from read_mcap import cells, corner, messages, part

ARMS = "known,predicted"


@pytest.fixture(scope="module")
def run(tmp_path_factory, short_map):
    """A run of two drives along a straight, with noise."""
    out = tmp_path_factory.mktemp("drive") / "run"
    words = ("--world", short_map, "--episodes", 1, "--arms", ARMS, "--predictor", "extend")
    assert compare(*words, "--noise", 0.01, "--jobs", 1, "--out", out) == 0
    return out


@pytest.fixture(scope="module")
def written(run):
    """The MCAP file of the drive with prediction."""
    assert plot.main([str(run), "--mcap"]) == 0
    return run / "drive-0-predicted.mcap"


def test_each_tick_has_its_scan_maps_and_plan(run, written):
    found, trace = messages(written), Run.load(run).trace(0, "predicted")
    ticks = len(trace.plans)
    counts = {topic: len(entries) for topic, entries in found.items()}
    each = ("/scan", "/observed", "/path", "/predicted", "/confidence", "/plan")
    assert counts == dict.fromkeys(each, ticks) | {"/tf_static": 1, "/tf": ticks + 1} | {
        "/pose": ticks + 1
    }
    assert [time for time, _ in found["/scan"]] == pytest.approx(0.1 * np.arange(1, ticks + 1))
    poses = [message.pose.position for _, message in found["/pose"]]
    assert np.array_equal([(at.x, at.y) for at in poses], trace.states[:, :2])
    assert written.with_suffix(".layout.json").exists()


def test_a_plan_begins_at_the_car_and_ends_at_rest(written):
    found = messages(written)
    for (_, plan), (_, pose) in zip(found["/plan"], found["/pose"], strict=False):
        points = [(p.pose.position.x, p.pose.position.y) for p in plan.poses]
        assert points[0] == (pose.pose.position.x, pose.pose.position.y)
        assert math.dist(points[-1], points[-2]) < 0.05


def test_the_observed_cells_are_those_of_the_trace(run, written):
    trace = Run.load(run).trace(0, "predicted")
    grid = messages(written)["/observed"][-1][1]
    frame = trace.truth.frame
    col, row = (round((a - b) / 0.05) for a, b in zip(corner(grid), frame.origin, strict=True))
    rows, cols = np.nonzero(cells(grid) != -1)
    seen = np.zeros(frame.shape, bool)
    inside = (rows + row >= 0) & (rows + row < frame.shape[0])
    inside &= (cols + col >= 0) & (cols + col < frame.shape[1])
    seen[(rows + row)[inside], (cols + col)[inside]] = True
    # A cell that one beam crosses and another ends in may have become unknown again.
    assert (trace.first_seen > 0)[seen].all()
    assert seen.sum() > 0.99 * (trace.first_seen > 0).sum()


def test_a_drive_without_prediction_has_none(run):
    assert plot.main([str(run), "--mcap", "--arm", "known"]) == 0
    found = messages(run / "drive-0-known.mcap")
    assert "/predicted" not in found
    assert "/plan" in found


def test_predictions_keep_what_was_observed(written):
    found = messages(written)
    for (_, known), (_, predicted) in zip(found["/observed"], found["/predicted"], strict=True):
        observed, shown = part(known, predicted)
        assert (shown[observed != -1] == observed[observed != -1]).all()


def test_the_file_is_a_log_of_its_lidar(run, written):
    log, states = read_bag(written), Run.load(run).trace(0, "predicted").states[:-1]
    # The LIDAR is 0.1 m in front of the car's centre.
    ahead = states[:, :2] + 0.1 * np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2])])
    np.testing.assert_allclose(log.poses[:, :2], ahead, atol=1e-6)
    assert len(log.scans[0].ranges) == 1081


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("first_seen", "the observed map of tick 0 of predicted in episode 0 differs"),
        ("moment_p_free", "the prediction of tick"),
        ("moment_prediction_frame", "the prediction of tick"),
    ],
)
def test_a_drive_that_is_not_made_again_alike_is_refused(run, tmp_path, capsys, name, said):
    copy = tmp_path / "run"
    copy.mkdir()
    shutil.copy(run / "results.json", copy)
    with np.load(run / "traces.npz") as file:
        arrays = {key: file[key] for key in file.files}
    changed = arrays[f"e0/predicted/{name}"]
    if name == "first_seen":
        changed[tuple(np.argwhere(changed == 1)[0])] = 7
    else:
        changed.flat[-1] += 5
    np.savez_compressed(copy / "traces.npz", **arrays)
    assert plot.main([str(copy), "--mcap", "--arm", "predicted"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert said in last
    assert not list(copy.glob("*.mcap*"))


def test_a_drive_with_late_ticks_is_refused(run, tmp_path, capsys):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    results = json.loads((copy / "results.json").read_text())
    for drive in results["episodes"]:
        drive["late_ticks"] = 3
    (copy / "results.json").write_text(json.dumps(results))
    assert plot.main([str(copy), "--mcap", "--arm", "predicted"]) == 2
    assert "3 ticks of this drive with --real-time were late" in capsys.readouterr().err
