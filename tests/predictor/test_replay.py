"""The replay of a robot's log: written as an MCAP file, and read back."""

import json
import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foresee.mapping.grid import GridFrame, OccupancyGrid
from foresee.mapping.scan import Scan
from foresee.prediction import Prediction
from predictor.data.bags import read_bag
from predictor.data.foxglove_layout import foxglove_layout
from predictor.data.laser_log import LaserLog
from predictor.data.log_files import read_log
from predictor.data.mcap_file import TYPES, McapError, writing_mcap
from predictor.data.survey import record
from predictor.evaluation.replayed_log import mapped_scans, scan_times
from predictor.replay import main
from sim import Lidar, LidarConfig, empty_straight

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from read_mcap import cells, corner, messages, part

SICK = LidarConfig(fov=math.pi, beams=181, range_max=80.0, mount=(0.0, 0.0, 0.0))
SCANS = 12


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a robot that drives along a corridor at 2 m/s, five scans a second."""
    world, lidar = empty_straight(16.0, 3.0), Lidar(SICK)
    lines = []
    for number in range(SCANS):
        pose = np.array([2.0 + 0.4 * number, 2.0, 0.05 * number])
        ranges = np.where(np.isfinite(r := lidar.scan(world, pose).ranges), r, 81.83)
        words = [len(ranges), *ranges.tolist(), *pose.tolist(), 0.0, 0.0, 0.0, 100 + 0.2 * number]
        lines.append(f"FLASER {' '.join(map(repr, words))} host 0\n")
    path = tmp_path_factory.mktemp("logs") / "corridor.log"
    path.write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def replayed(log, tmp_path_factory):
    """The log, replayed with a predictor that predicts something everywhere."""
    out = tmp_path_factory.mktemp("replayed") / "corridor.mcap"
    assert replay(log, out) == 0
    return out


def replay(log, out, *words, predictor="extend"):
    return main([str(log), "--out", str(out), "--predictor", predictor, *words])


def test_another_library_reads_every_message_in_the_order_of_time(replayed):
    reader = pytest.importorskip("mcap.reader")
    factory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory()
    times, grids = [], []
    with replayed.open("rb") as file:
        opened = reader.make_reader(file, validate_crcs=True)
        summary = opened.get_summary()
        counted = summary.statistics.channel_message_counts
        counts = {summary.channels[key].topic: count for key, count in counted.items()}
        for schema, channel, message in opened.iter_messages(log_time_order=False):
            times.append(message.log_time)
            decoded = factory.decoder_for(channel.message_encoding, schema)(message.data)
            assert schema.name == TYPES[channel.topic]
            if channel.topic == "/observed":
                grids.append(decoded)
    assert counts == dict.fromkeys(set(TYPES) - {"/plan", "/tf_static"}, SCANS)
    assert times == sorted(times)
    assert (times[0], times[-1]) == (100 * 10**9, round((100 + 0.2 * (SCANS - 1)) * 1e9))
    assert cells(grids[-1]).tolist() == cells(messages(replayed)["/observed"][-1][1]).tolist()


def test_the_observed_map_is_that_of_the_frames_of_the_log(log, replayed):
    observed = messages(replayed)["/observed"]
    frames = record(read_log(log)).arrays()["remembered"]
    for (_, grid), frame, pose in zip(observed, frames, read_log(log).poses, strict=True):
        known = np.full(np.array(cells(grid).shape) + 800, -1, np.int8)
        known[400:-400, 400:-400] = cells(grid)
        # The square of a frame is 10 m wide.
        col, row = (
            round((p - c - 5.0) / 0.05) + 400 for p, c in zip(pose[:2], corner(grid), strict=True)
        )
        assert (known[row : row + 200, col : col + 200] == np.int8([0, 100, -1])[frame]).all()


def test_what_is_written_is_a_bag_that_replays_alike(log, replayed, tmp_path):
    first, again = read_log(log), read_bag(replayed)
    np.testing.assert_allclose(again.poses, first.poses, atol=1e-9)
    np.testing.assert_allclose(again.times, first.times, atol=1e-6)
    for one, other in zip(first.scans, again.scans, strict=True):
        np.testing.assert_allclose(other.ranges, one.ranges, rtol=1e-6)
        assert other.angle_increment == pytest.approx(one.angle_increment)
    assert replay(replayed, tmp_path / "again.mcap") == 0
    ends = [messages(path)["/observed"][-1][1] for path in (replayed, tmp_path / "again.mcap")]
    assert corner(ends[0]) == pytest.approx(corner(ends[1]))
    # Ranges are in single precision in the bag, so that a beam may end in the next cell.
    assert (cells(ends[0]) != cells(ends[1])).mean() < 1e-3


def test_predictions_are_percentages_and_keep_what_was_observed(replayed):
    found = messages(replayed)
    times = [[time for time, _ in found[topic]] for topic in ("/observed", "/predicted")]
    assert times[0] == times[1]
    predicted_more = 0
    for (_, known), (_, predicted), (_, trust) in zip(
        found["/observed"], found["/predicted"], found["/confidence"], strict=True
    ):
        assert cells(predicted).min() >= -1
        assert cells(predicted).max() <= 100
        assert cells(trust).min() >= 0
        assert cells(trust).max() <= 100
        observed, shown = part(known, predicted)
        seen = observed != -1
        assert (shown[seen] == observed[seen]).all()
        assert (cells(trust)[seen] == 100).all()
        predicted_more += int((shown[~seen] != -1).sum())
    assert predicted_more > 0


def test_a_scan_and_its_transform_are_written_together_and_the_path_leads_to_it(replayed):
    found = messages(replayed)
    for (time, scan), (moved, entry), (_, pose) in zip(
        found["/scan"], found["/tf"], found["/pose"], strict=True
    ):
        transform = entry.transforms[0]
        assert time == moved
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "laser")
        assert scan.header.frame_id == "laser"
        assert transform.header.stamp == scan.header.stamp
        assert transform.transform.translation.x == pose.pose.position.x
    path = found["/path"][-1][1].poses
    x = [point.pose.position.x for point in path]
    assert x[0] == 2.0
    assert np.diff(x).min() > 0
    assert found["/pose"][-1][1].pose.position.x - x[-1] <= 0.5


def test_cells_without_a_prediction_and_those_that_nobody_can_observe_are_unknown(tmp_path):
    frame = GridFrame(0.05, (1.0, 2.0), (1, 4))
    free, occupied, trust = np.float32(
        [[[0.9, 0.3, 0.1, 0.9]], [[0.1, 0.6, 0.2, 0.1]], [[0.5, 1.0, 1.0, 0.0]]]
    )
    with writing_mcap(tmp_path / "a.mcap", {}) as file:
        file.predicted(1.0, Prediction(frame, free, occupied, trust))
    found = messages(tmp_path / "a.mcap")
    assert cells(found["/predicted"][0][1]).tolist() == [[10, 60, -1, -1]]
    assert cells(found["/confidence"][0][1]).tolist() == [[50, 100, 100, 0]]


def test_none_predicts_nothing(log, tmp_path):
    assert replay(log, tmp_path / "a.mcap", predictor="none") == 0
    found = messages(tmp_path / "a.mcap")
    observed, shown = part(found["/observed"][-1][1], found["/predicted"][-1][1])
    assert (observed == shown).all()


@given(
    st.lists(st.floats(0.0, 3.0), min_size=1, max_size=40),
    st.integers(1, 5),
    st.floats(0.1, 20.0),
)
def test_maps_are_never_more_frequent_than_asked_and_the_last_scan_has_one(steps, every, rate):
    times = np.cumsum(steps)
    chosen = mapped_scans(times, every, rate)
    assert chosen[0] == 0
    assert chosen[-1] == len(times) - 1
    regular = [number for number in chosen if number % every == 0]
    assert set(chosen) - set(regular) <= {len(times) - 1}
    between = [b - a for a, b in zip(times[regular[:-1]], times[regular[1:]], strict=False)]
    assert all(gap >= 0.99 / rate for gap in between[:-1])


def test_without_a_clock_the_robot_drives_at_a_metre_a_second(log):
    poses = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 1.0]])
    scan = Scan(np.ones(3), 0.0, 0.1, 20.0)
    clockless = LaserLog("a", (scan,) * 3, poses, None)
    assert np.diff(scan_times(clockless)) == pytest.approx([5.0, 0.1])
    timed = read_log(log)
    assert scan_times(timed) is timed.times


def test_fewer_maps_are_those_of_the_same_times(log, replayed, tmp_path):
    assert replay(log, tmp_path / "a.mcap", "--every", "4") == 0
    assert replay(log, tmp_path / "b.mcap", "--rate", "1") == 0
    whole = {round(t, 6): cells(grid) for t, grid in messages(replayed)["/observed"]}
    for path, count in ((tmp_path / "a.mcap", 4), (tmp_path / "b.mcap", 4)):
        found = messages(path)
        assert len(found["/scan"]) == SCANS
        assert len(found["/observed"]) == len(found["/predicted"]) == count
        for time, grid in found["/observed"]:
            assert np.array_equal(cells(grid), whole[round(time, 6)])


def test_a_wider_window_is_observed_and_a_wider_square_predicted(log, tmp_path):
    words = ("--window", "8", "--expansion", "1.5")
    assert replay(log, tmp_path / "a.mcap", *words) == 0
    found = messages(tmp_path / "a.mcap")
    assert found["/predicted"][0][1].info.width == 240
    # The laser looks ahead only, as far as half a window.
    assert np.ptp(np.nonzero(cells(found["/observed"][0][1]) != -1)[1]) + 1 == 80


def test_the_file_says_how_it_was_made(replayed):
    text = replayed.read_bytes()
    assert b'"predictor": "extend"' in text
    assert b'"log": "corridor"' in text


def test_a_file_that_exists_is_refused_and_kept(log, tmp_path, capsys):
    for name in ("a.mcap", "a.layout.json"):
        (tmp_path / name).write_text("mine")
        assert replay(log, tmp_path / "a.mcap") == 2
        assert f"{name} exists" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == [name]
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()


class Tires:
    """A predictor that raises when it is asked for the third time."""

    def __init__(self):
        self.asked = 0

    def predict(self, view):
        self.asked += 1
        if self.asked == 3:
            raise RuntimeError("tired")
        cells = np.full(view.known.frame.shape, 0.5, np.float32)
        return Prediction(view.known.frame, cells, cells, cells)


@pytest.mark.parametrize(
    ("out", "words", "said"),
    [
        ("a.bag", (), "must end in .mcap"),
        ("a.mcap", ("--every", "0"), "--every is 0"),
        ("a.mcap", ("--predictor", "nobody"), "no predictor is named 'nobody'"),
        ("a.mcap", ("--predictor", f"{__name__}:Tires"), "raised RuntimeError: tired"),
    ],
)
def test_nothing_is_left_of_a_replay_that_fails(log, tmp_path, capsys, out, words, said):
    assert replay(log, tmp_path / out, *words) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_missing_log_is_named(tmp_path, capsys):
    assert replay(tmp_path / "no.log", tmp_path / "a.mcap") == 2
    assert "no.log: no such file" in capsys.readouterr().err


def test_times_that_no_stamp_can_hold_are_refused(tmp_path):
    for time in (-1.0, 2.0**31, math.nan):
        with (
            pytest.raises(McapError, match="no stamp of ROS"),
            writing_mcap(tmp_path / "a.mcap", {}) as file,
        ):
            file.place(time, np.zeros(3), "laser")
    assert list(tmp_path.iterdir()) == []


def test_without_rosbags_a_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with (
        pytest.raises(McapError, match=r"pip install 'foresee-nav\[bags\]'"),
        writing_mcap(tmp_path / "a.mcap", {}),
    ):
        pass


def test_the_layout_shows_topics_of_the_file(replayed):
    layout = json.loads(foxglove_layout())
    beside = json.loads(replayed.with_suffix(".layout.json").read_text())
    assert beside == layout
    panels = layout["configById"]
    assert {layout["layout"]["first"], layout["layout"]["second"]} == set(panels)
    shown = set().union(*(panel["topics"] for panel in panels.values()))
    assert shown <= set(TYPES)
    assert {"/observed", "/predicted", "/confidence", "/path", "/scan"} <= shown


def test_a_map_of_one_row_keeps_its_shape_and_corner(tmp_path):
    known = OccupancyGrid(GridFrame(0.05, (-3.0, 7.0), (1, 5)), 5.0)
    known.log_odds[0, 2], known.log_odds[0, 3] = 17, -8
    with writing_mcap(tmp_path / "a.mcap", {}) as file:
        file.observed(0.5, known)
    ((_, grid),) = messages(tmp_path / "a.mcap")["/observed"]
    assert cells(grid).tolist() == [[-1, -1, 100, 0, -1]]
    assert corner(grid) == (-3.0, 7.0)
