"""From a log to frames: the map of all scans, and what each scan found it to be."""

import json
import math

import numpy as np
import pytest

from foresee.mapping.grid import GridFrame, world_hash
from foresee.mapping.scan import Scan
from predictor.data.frames import Frames
from predictor.data.laser_log import LaserLog, LogError
from predictor.data.log_files import log_sources, logs_in, site_name
from predictor.data.squares import decode_cells
from predictor.data.survey import clipped, frame_around, record, surveyed
from sim import Lidar, LidarConfig, generate
from sim.task import sample_task

SICK = LidarConfig(fov=math.pi, beams=361, range_max=80.0, mount=(0.0, 0.0, 0.0))


def a_journey(seed=3):
    """A log as a real robot would leave it, every half metre; and the building."""
    task = sample_task(generate("office", seed), seed)
    way = np.vstack([task.start[:2], task.waypoints])
    at = np.linspace(0, len(way) - 1, 4 * len(way))
    points = np.stack([np.interp(at, np.arange(len(way)), way[:, i]) for i in (0, 1)], axis=1)
    ways = np.gradient(points, axis=0)
    poses = np.column_stack([points, np.arctan2(ways[:, 1], ways[:, 0])])
    lidar = Lidar(SICK)
    scans = tuple(lidar.scan(task.world, pose) for pose in poses)
    return LaserLog("office", scans, poses, np.arange(len(poses)) + 100.0), task.world


@pytest.fixture(scope="module")
def journey():
    return a_journey()


def line(scan, pose, time):
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, 81.83)
    numbers = [len(ranges), *ranges.tolist(), *pose.tolist(), 0.0, 0.0, 0.0, time]
    return "FLASER " + " ".join(map(repr, numbers)) + f" host {time}\n"


def test_the_map_of_all_scans_is_the_building_where_it_was_seen(journey):
    log, world = journey
    frame = frame_around(log.poses, 20.0)
    truth = surveyed(frame, [clipped(scan, 20.0) for scan in log.scans], log.poses)
    free, surface = world.truth(frame)
    assert not (truth == 0)[~free].any()
    assert not (truth == 1)[~surface].any()
    assert (truth == 0).sum() > 0.2 * free.sum()
    assert (truth == 1).sum() > 300


def test_who_walks_past_is_not_in_the_map(journey):
    log, world = journey
    rng = np.random.default_rng(0)
    scans = []
    for number, scan in enumerate(log.scans):
        ranges = scan.ranges.copy()
        if number % 3 == 0:
            # Somebody stands 1.5 m away, each time elsewhere, before some thirty beams.
            first = int(rng.integers(0, 330))
            ranges[first : first + 30] = np.fmin(ranges[first : first + 30], 1.5)
        scans.append(Scan(ranges, scan.angle_min, scan.angle_increment, 20.0))
    frame = frame_around(log.poses, 20.0)
    free, _ = world.truth(frame)
    clean = surveyed(frame, [clipped(scan, 20.0) for scan in log.scans], log.poses)
    crowded = surveyed(frame, scans, log.poses)
    hurt = (crowded == 1) & free
    seen_free = (clean == 0).sum()
    assert hurt.sum() < 0.005 * seen_free
    # A map that kept every return would hold all of them.
    stood = sum(np.isclose(scan.ranges, 1.5).sum() for scan in scans)
    assert hurt.sum() < 0.2 * stood


def test_the_order_of_the_scans_does_not_matter(journey):
    log, _ = journey
    frame = frame_around(log.poses, 20.0)
    scans = [clipped(scan, 20.0) for scan in log.scans]
    back = surveyed(frame, scans[::-1], log.poses[::-1])
    assert np.array_equal(surveyed(frame, scans, log.poses), back)


def test_frames_grow_with_the_journey_and_never_contradict_the_building(journey):
    log, world = journey
    recording = record(log)
    arrays = recording.arrays()
    assert len(recording) == len(log)
    free, surface = world.truth(recording.frame)
    pad = [np.pad(cells, 200) for cells in (free, surface)]
    for number in range(0, len(log), 7):
        row, col = arrays["corners"][number] + 200
        x, y = recording.frame.centre(row - 200 + 99.5, col - 200 + 99.5)
        assert math.dist((x, y), log.poses[number, :2]) < 0.05
        parts = [cells[row : row + 200, col : col + 200] for cells in pad]
        remembered, estimated = arrays["remembered"][number], arrays["estimated"][number]
        assert not (remembered == 0)[~parts[0]].any()
        assert not (remembered == 1)[~parts[1]].any()
        inner = remembered[50:150, 50:150]
        # The whole LIDAR has seen all that the confined one has, and the same.
        assert np.array_equal(estimated[inner != 2], inner[inner != 2])
    assert np.isnan(arrays["states"][:, 3]).all()
    assert np.isnan(arrays["actions"]).all()
    assert np.array_equal(arrays["times"], np.arange(len(log)))


def test_the_confined_lidar_writes_into_its_window_alone(journey):
    log, _ = journey
    alone = LaserLog("one", log.scans[:1], log.poses[:1], None)
    remembered = record(alone).arrays()["remembered"][0].copy()
    remembered[49:151, 49:151] = 2
    assert (remembered == 2).all()
    assert np.isnan(record(alone).arrays()["times"]).all()


def test_a_reach_makes_far_returns_free_space():
    scan = Scan(np.array([25.0, 5.0]), 0.0, math.pi / 2, 80.0)
    near = clipped(scan, 20.0)
    frame = GridFrame(0.05, (-25.0, -25.0), (1000, 1000))
    truth = surveyed(frame, [near], np.array([[0.02, 0.02, 0.0]]))
    rows, cols = np.nonzero(truth == 1)
    assert list(zip(rows, cols, strict=True)) == [frame.cell(0.02, 5.02)]
    assert truth[frame.cell(19.9, 0.02)] == 0
    assert truth[frame.cell(20.1, 0.02)] == 2


def test_poses_that_no_building_holds_are_an_error():
    poses = np.array([[0.0, 0.0, 0.0], [3000.0, 0.0, 0.0]])
    with pytest.raises(LogError, match="3000 m apart, at most 1000 m"):
        frame_around(poses, 20.0)
    low = frame_around(poses[:1] + 0.03, 20.0)
    assert low.contains(20.0, 20.0)
    assert low.contains(-19.9, -19.9)


def test_the_command_makes_a_set_of_logs(journey, tmp_path, capsys):
    from predictor.dataset import main

    log, _ = journey
    lines = [line(*entry) for entry in zip(log.scans, log.poses, range(len(log)), strict=True)]
    words = lines[5].split()
    words[8] = "nan"
    lines[5] = " ".join(words) + "\n"
    path = tmp_path / "office.log"
    path.write_text("".join(lines))
    out = tmp_path / "set"
    assert main(["--log", str(path), "--out", str(out), "--jobs", "1"]) == 0
    assert f"office: {len(log)} frames" in (said := capsys.readouterr().err)
    assert "skipped: 1 bad ranges" in said
    frames = Frames.load(out, "physical")
    assert len(frames) == len(log)
    facts = frames.about[0]
    assert (facts["map"], facts["clock"], facts["skipped"]) == (
        "office",
        True,
        {"bad ranges": 1, "bad scans": 0},
    )
    assert frames.worlds == {world_hash(decode_cells(frames.maps[0]))}
    truth = frames.truth(slice(None), 1.0)
    agree = (frames.estimated == truth) | (frames.estimated == 2)
    assert agree.mean() > 0.99


@pytest.mark.parametrize(
    ("text", "says"),
    [("ODOM 0 0\n", "no FLASER line"), ("FLASER 3 1 2\n", "cut off")],
)
def test_a_log_that_cannot_be_read_leaves_no_frames_and_says_why(tmp_path, capsys, text, says):
    from predictor.dataset import main

    path = tmp_path / "bad.log"
    path.write_text(text)
    assert main(["--log", str(path), "--out", str(tmp_path / "set"), "--jobs", "1"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert says in said
    assert not list((tmp_path / "set").iterdir())


def short_log(path, log, first):
    path.write_text("".join(line(log.scans[i], log.poses[i], i) for i in range(first, first + 3)))
    return path


def test_a_log_that_has_changed_is_read_again(tmp_path, journey):
    from predictor.dataset import main

    path = short_log(tmp_path / "office.log", journey[0], 0)
    command = ["--log", str(path), "--out", str(tmp_path / "set"), "--jobs", "1"]
    assert main(command) == 0
    first = Frames.load(tmp_path / "set").about[0]
    assert main(command) == 0
    assert Frames.load(tmp_path / "set").about[0] == first
    (tmp_path / "office.json").write_text(json.dumps({"no_return_at_or_above_m": 2}))
    assert main(command) == 0
    again = Frames.load(tmp_path / "set").about[0]
    assert again["source"] != first["source"]
    assert again["sha256"] != first["sha256"]


def test_a_set_grows_and_shrinks_by_logs_and_a_bad_one_spoils_nothing(tmp_path, journey, capsys):
    from predictor.dataset import main

    log, out = journey[0], tmp_path / "set"
    good, other = (short_log(tmp_path / f"{n}.log", log, 3 * i) for i, n in enumerate("ab"))
    bad = tmp_path / "bad.log"
    bad.write_text("FLASER 3 1 2\n")

    def made(*paths):
        return main(["--log", *map(str, paths), "--out", str(out), "--jobs", "1"])

    assert made(good, bad) == 2
    assert "cut off" in capsys.readouterr().err
    assert made(good) == 0
    first = Frames.load(out).about
    assert [facts["map"] for facts in first] == ["a"]
    assert made(good, other) == 0
    both = Frames.load(out).about
    assert [facts["map"] for facts in both] == ["a", "b"]
    assert both[0] == first[0]
    assert made(other) == 0
    assert [facts["map"] for facts in Frames.load(out).about] == ["b"]


def test_two_logs_of_one_name_or_missing_ones_are_refused(tmp_path):
    paths = [tmp_path / name / "a.log" for name in ("one", "two")]
    with pytest.raises(LogError, match="no such file"):
        log_sources(paths)
    for path in paths:
        path.parent.mkdir()
        path.write_text("x")
    with pytest.raises(LogError, match="each site once"):
        log_sources(paths)
    assert site_name(paths[0]) == "a"


def test_a_folder_stands_for_its_logs_alone(tmp_path):
    for name in ("b.log.gz", "a.clf", "README.txt", "a.json", "drive.bag"):
        (tmp_path / name).write_text("x")
    (tmp_path / "ros2").mkdir()
    (tmp_path / "ros2" / "metadata.yaml").write_text("x")
    names = ["a.clf", "b.log.gz", "drive.bag", "ros2"]
    assert [path.name for path in logs_in([tmp_path])] == names
    one = tmp_path / "ros2"
    assert logs_in([one, tmp_path / "README.txt"]) == [one, tmp_path / "README.txt"]
    (one / "metadata.yaml").unlink()
    with pytest.raises(LogError, match="ros2 holds no log"):
        logs_in([one])
