"""How far a car may rely on a prediction, by several scores."""

import json

import numpy as np
import pytest
from comparison import run as compare

from benchmarks.studies.driver import arcs, sweeps
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame

FRAME = GridFrame(0.05, (0.0, 0.0), (60, 120))
POSE = np.array([1.0, 1.5, 0.0])


def swept(trust, wall_at=None, seen_wall_at=None):
    """The arc straight ahead: all is observed up to x = 2 m, and free but for a wall."""
    cells = np.full(FRAME.shape, FREE, np.int8)
    cells[:, 40:] = UNKNOWN
    free = np.ones(FRAME.shape, bool)
    if seen_wall_at is not None:
        cells[:, round(seen_wall_at / 0.05)] = OCCUPIED
    if wall_at is not None:
        free[:, round(wall_at / 0.05)] = False
    trusts = np.full(FRAME.shape, 1.0)
    trusts[:, 40:] = trust
    return arcs._swept(Grid(FRAME, cells), (trusts, trusts), free, POSE, 0.0)


def test_scores_fall_along_an_arc_from_where_the_observed_space_ends():
    arc = swept(0.999)
    # The front of the body is 0.25 m ahead of its centre: it leaves the observed space at 0.8 m.
    assert arc[0, 0] == pytest.approx(0.1)
    assert len(arc) == len(np.arange(0.0, arcs.LENGTH, arcs.STEP)) - 8
    least, near, product, bound = arc[:, 2:].T
    assert np.all(least == 0.999)
    assert np.all(near == 0.999)
    assert product == pytest.approx(0.999 ** np.arange(1, len(arc) + 1))
    assert np.all(np.diff(bound) < 0.0)
    assert not arc[:, 1].any()


def test_an_arc_is_wrong_from_a_wall_on_that_was_not_observed():
    arc = swept(0.999, wall_at=3.0)
    # The front is there after 1.75 m, and was 1 m ahead at the end of the observed space.
    assert arc[arc[:, 1] > 0, 0].min() == pytest.approx(1.1, abs=0.06)
    assert np.all(np.diff(arc[:, 1]) >= 0.0)


def test_an_arc_ends_at_an_observed_wall():
    assert len(swept(0.9, seen_wall_at=1.8)) == 0
    assert 0 < len(swept(0.9, seen_wall_at=2.5)) < len(swept(0.9))


def test_the_best_threshold_keeps_to_the_share_of_wrong_arcs():
    # The second arc is wrong from its end on, where its score is 0.5.
    good = np.array([[0.1, 0.0, 0.9], [0.2, 0.0, 0.5]])
    bad = np.array([[0.1, 0.0, 0.9], [0.2, 1.0, 0.5]])
    sums = arcs._entries([good, bad], 2).sum(axis=1, keepdims=True)
    assert arcs._farthest(sums, 0.0) == pytest.approx(0.1)
    assert arcs._farthest(sums, 0.5) == pytest.approx(0.2)


def test_the_command_analyses_drives_without_prediction(short_map, tmp_path, capsys):
    run, out = tmp_path / "run", tmp_path / "sweeps.json"
    words = ["--world", short_map, "--episodes", 1, "--arms", "known", "--jobs", 1]
    assert compare(*words, "--predictor", "extend", "--out", run) == 0
    capsys.readouterr()
    assert sweeps.main([str(run), "--out", str(out)]) == 0
    found = json.loads(out.read_text())
    assert sweeps.table(found) in capsys.readouterr().out
    (one,) = found["runs"]
    assert set(one["scores"]) == set(arcs.SCORES)
    for shares in one["scores"].values():
        far = [share["value"] for share in shares]
        assert far == sorted(far)


def test_drives_with_a_noisy_lidar_are_refused(short_map, tmp_path, capsys):
    words = ["--world", short_map, "--episodes", 1, "--arms", "known", "--jobs", 1]
    assert compare(*words, "--noise", 0.01, "--out", tmp_path / "run") == 0
    assert sweeps.main([str(tmp_path / "run"), "--out", str(tmp_path / "s.json")]) == 2
    assert "no noise" in capsys.readouterr().err
