"""Logs made by simulation, and the samples of them."""

import json

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from foresee.infra.command_line import UsageError
from predictor.data.samples import Samples
from predictor.data.survey import frame_around, surveyed
from predictor.recording.sample_set import DRIVES
from predictor.recording.simulated_log import ROBOT, SimulatedLogConfig, poses_along, simulated_log
from predictor.recording.training_drives import (
    APART,
    SPREAD,
    DrivesConfig,
    make,
)
from sim.families import generate
from sim.task import sample_task

CLEAN = SimulatedLogConfig(noise=(0.0,), dropout=(0.0,), people=(0.0,), misplaced=(0.0,))


@pytest.fixture(scope="module")
def task():
    return sample_task(generate("corridor", 3), 3)


def test_a_log_has_a_scan_of_180_degrees_at_every_pose(task):
    log = simulated_log([task], np.random.default_rng(0), SimulatedLogConfig(apart=(0.4, 0.4)))
    assert len(log) == len(log.poses)
    for scan in log.scans:
        assert scan.angle_min == pytest.approx(-np.pi / 2)
        assert (len(scan.ranges) - 1) * scan.angle_increment == pytest.approx(np.pi)
    steps = np.hypot(*np.diff(log.poses[:, :2], axis=0).T)
    assert np.median(steps) == pytest.approx(0.4, abs=0.1)


def test_the_robot_looks_where_it_is_going():
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]])
    poses = poses_along(corner, 0.5)
    assert np.allclose(poses[:7, 2], 0.0)
    assert np.allclose(poses[8:, 2], np.pi / 2)
    assert poses[7, 2] == pytest.approx(np.pi / 4)


def test_without_errors_the_map_is_of_the_building(task):
    log = simulated_log([task], np.random.default_rng(0), CLEAN)
    frame = frame_around(log.poses, 20.0)
    truth = surveyed(frame, list(log.scans), log.poses)
    # The log's map lies a part of a cell off the building's.
    off = log.poses[0, :2] - task.start[:2]
    assert (off >= 0).all()
    assert (off < 0.05).all()
    xs, ys = frame.centres()
    world = task.world.grid
    cols = np.floor((xs - off[0] - world.frame.origin[0]) / 0.05).astype(int)
    rows = np.floor((ys - off[1] - world.frame.origin[1]) / 0.05).astype(int)
    inside = np.ix_(
        (rows >= 0) & (rows < world.frame.shape[0]), (cols >= 0) & (cols < world.frame.shape[1])
    )
    truth, near = truth[inside], np.ix_(rows[inside[0].ravel()], cols[inside[1].ravel()])
    assert (truth == 0).sum() > 10_000
    assert world.free[near][truth == 0].mean() > 0.98
    # A cell of the log's lies on up to four of the building's.
    around = binary_dilation(task.world.surface, np.ones((3, 3), dtype=bool))
    assert around[near][truth == 1].mean() > 0.99
    assert (world.free[near] & (truth == 2)).any()


def test_ways_through_one_building_follow_on_each_other(task):
    other = sample_task(task.world, 4)
    log = simulated_log([task, other], np.random.default_rng(0), CLEAN)
    assert np.allclose(log.poses[0, :2], task.start[:2], atol=0.05)
    jumps = np.hypot(*np.diff(log.poses[:, :2], axis=0).T) > 1.5
    assert jumps.sum() == 1
    assert np.allclose(log.poses[1:][jumps][0, :2], other.start[:2], atol=0.05)


def test_the_truth_of_a_sample_is_what_the_log_maps(tmp_path):
    config = DrivesConfig(tmp_path, train=1, validation=1, simulated_logs=1.0, families=("narrow",))
    make(config, 1)
    samples = Samples.load(tmp_path / "train")
    assert samples.about[0]["family"] == "narrow"
    codes = np.stack([samples[n] for n in range(len(samples))])
    known, truth = codes % 3, codes // 3
    assert len(samples) > 10
    # What was seen free is free on the map of all scans, but for who walked by and for noise.
    assert (truth[known == 0] == 0).mean() > 0.95
    # The map holds more than was known at any moment.
    assert ((truth == 0) & (known == 2)).any()
    # Poses are a little off: of walls that were seen, the map has no more than their face.
    assert (truth[known == 1] == 2).mean() < 0.5
    assert json.loads((tmp_path / "recipe.json").read_text())["log"]["apart"] == [0.1, 1.0]


def test_samples_of_a_log_lie_as_far_apart_after_a_jump_as_before(tmp_path, monkeypatch):
    ways = 4
    monkeypatch.setattr("predictor.recording.training_drives.JOURNEYS", (ways,))
    config = DrivesConfig(tmp_path, train=1, validation=1, views=1, simulated_logs=1.0)
    make(config, 1)
    count = len(Samples.load(tmp_path / "train"))
    task = [
        sample_task(generate("corridor", DRIVES["train"]), DRIVES["train"] + n * SPREAD, ROBOT)
        for n in range(ways)
    ]
    way = sum(one.path_length for one in task)
    # The errors of the poses make the logged way a little longer.
    assert 0 < count <= 1.1 * way / APART + ways


@pytest.mark.slow(7)
def test_logs_and_drives_do_not_share_a_folder(tmp_path):
    make(DrivesConfig(tmp_path, train=1, validation=1, simulated_logs=1.0), 1)
    with pytest.raises(UsageError, match="holds a run with"):
        make(DrivesConfig(tmp_path, train=1, validation=1), 1)
