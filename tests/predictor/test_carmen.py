"""CARMEN logs: what is in them comes out, and what is wrong with one is said in a line."""

import gzip
import json
import math

import numpy as np
import pytest

from predictor.data.carmen import log_name, read_carmen
from predictor.data.laser_log import LogError

HEAD = "# a log\nPARAM robot_length 0.3\nODOM 0 0 0 0 0 0 0.1 host 0.1\n"


def line(ranges, pose=(1.0, 2.0, 0.5), time=3.0):
    numbers = " ".join(str(r) for r in ranges)
    x, y, yaw = pose
    return f"FLASER {len(ranges)} {numbers} {x} {y} {yaw} 9 9 9 {time} host {time}\n"


def write(path, text, packed=False):
    path.write_bytes(gzip.compress(text.encode()) if packed else text.encode())
    return path


def scans(count, beams=180):
    return "".join(line([5.0] * beams, (0.5 * i, 0.0, 0.0), 10.0 + i) for i in range(count))


@pytest.mark.parametrize("packed", [False, True])
def test_ranges_poses_and_times_come_out(tmp_path, packed):
    name = "site.log.gz" if packed else "site.log"
    ranges = np.linspace(1, 20, 181).round(3)
    text = HEAD + line(ranges, (1.0, 2.0, 0.5), 3.0) + line(ranges[::-1], (1.5, 2.0, 0.6), 4.0)
    log = read_carmen(write(tmp_path / name, text, packed))
    assert log.name == "site"
    assert len(log) == 2
    assert np.array_equal(log.scans[0].ranges, ranges)
    assert np.array_equal(log.poses, [[1.0, 2.0, 0.5], [1.5, 2.0, 0.6]])
    assert log.times is not None
    assert np.array_equal(log.times, [3.0, 4.0])
    assert log.skipped == {"bad ranges": 0, "bad scans": 0}


@pytest.mark.parametrize(("beams", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_beams_look_to_the_front_half(tmp_path, beams, step):
    scan = read_carmen(write(tmp_path / "a.log", scans(1, beams))).scans[0]
    assert scan.angle_min == pytest.approx(-math.pi / 2)
    assert scan.angle_increment == pytest.approx(math.radians(step))


def test_other_numbers_of_beams_need_somebody_to_say_where_they_look(tmp_path):
    path = write(tmp_path / "a.log.gz", scans(1, 541), packed=True)
    with pytest.raises(LogError, match=r"541 beams.*angle_min_deg.*a\.json"):
        read_carmen(path)
    (tmp_path / "a.json").write_text(json.dumps({"angle_min_deg": -135, "angle_inc_deg": 0.5}))
    scan = read_carmen(path).scans[0]
    assert scan.angle_min == pytest.approx(math.radians(-135))
    assert scan.angle_increment == pytest.approx(math.radians(0.5))


def test_no_return_says_nothing_and_the_file_beside_the_log_says_from_where_on(tmp_path):
    path = write(tmp_path / "a.log", line([1.0, 49.4, 49.5, 79.9, 80.0, 81.83] * 30))
    assert np.isnan(read_carmen(path).scans[0].ranges[:6]).tolist() == [False] * 4 + [True] * 2
    (tmp_path / "a.json").write_text(json.dumps({"no_return_at_or_above_m": 49.5}))
    scan = read_carmen(path).scans[0]
    assert np.isnan(scan.ranges[:6]).tolist() == [False] * 2 + [True] * 4
    assert scan.range_max == 49.5


def test_nan_and_negative_ranges_say_nothing_and_are_counted(tmp_path):
    ranges = [5.0] * 180
    ranges[3], ranges[4], ranges[5] = "nan", -1.0, "-inf"
    log = read_carmen(write(tmp_path / "a.log", line(ranges) + line([5.0] * 180)))
    assert log.skipped == {"bad ranges": 3, "bad scans": 0}
    assert np.flatnonzero(np.isnan(log.scans[0].ranges)).tolist() == [3, 4, 5]


def test_a_clock_that_stands_or_goes_back_is_none(tmp_path):
    for times in [(1e9, 1e9, 1e9), (1.0, 3.0, 2.0)]:
        text = "".join(line([5.0] * 180, time=time) for time in times)
        assert read_carmen(write(tmp_path / "a.log", text)).times is None
    path = write(tmp_path / "b.log", scans(3))
    assert read_carmen(path).times is not None
    (tmp_path / "b.json").write_text(json.dumps({"timestamps_usable": False}))
    assert read_carmen(path).times is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD, r"no FLASER line; its lines are: PARAM, ODOM"),
        ("", "no FLASER line; its lines are: none"),
        (scans(2)[:-400], "line 2 is cut off: 180 ranges"),
        (scans(2).rsplit(maxsplit=1)[0], "line 2 is cut off: 1 words after its time"),
        (scans(1).replace("FLASER 180", "FLASER 179", 1), "line 1 has 1 words too many"),
        (scans(1).replace("5.0", "5,0", 1), "line 1: could not convert"),
        ("FLASER\n", "line 1: FLASER is followed by no number of beams"),
        ("FLASER many 1 2\n", "no number of beams"),
        ("FLASER -4 1 2\n", "a scan of -4 beams"),
        (line([5.0] * 180, pose=("nan", 0, 0)), "pose or time is not finite"),
    ],
)
def test_what_is_wrong_with_a_log_is_said(tmp_path, text, says):
    with pytest.raises(LogError, match=says) as caught:
        read_carmen(write(tmp_path / "a.log", text))
    assert "\n" not in str(caught.value)
    assert "a.log" in str(caught.value)


def test_a_packed_log_that_is_cut_off_is_an_error(tmp_path):
    path = write(tmp_path / "a.log.gz", HEAD + scans(200), packed=True)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(LogError, match="is cut off after line"):
        read_carmen(path)


def test_a_packed_log_with_wrong_bytes_is_an_error(tmp_path):
    path = write(tmp_path / "a.log.gz", HEAD + scans(200), packed=True)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 20] = bytes(20)
    path.write_bytes(bytes(data))
    with pytest.raises(LogError):
        read_carmen(path)


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("packed", [False, True])
def test_a_comment_may_hold_any_letter(tmp_path, encoding, packed):
    path = tmp_path / "a.log"
    text = ("# Flur im Erdgeschoß, Gebäude für Prüfungen\n" + scans(3)).encode(encoding)
    path.write_bytes(gzip.compress(text) if packed else text)
    assert len(read_carmen(path)) == 3


def test_scans_without_beams_are_skipped_and_counted(tmp_path):
    path = write(tmp_path / "a.log", scans(2) + line([]) + line([5.0]) + scans(1))
    log = read_carmen(path)
    assert len(log) == 3
    assert log.skipped["bad scans"] == 2
    with pytest.raises(LogError, match="each of its 1 scans has less than two beams"):
        read_carmen(write(tmp_path / "b.log", line([])))


def test_a_file_that_is_no_text_is_an_error(tmp_path):
    path = tmp_path / "a.log"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(LogError, match="it is not text"):
        read_carmen(path)


def test_a_missing_log_is_an_error(tmp_path):
    with pytest.raises(LogError, match="No such file"):
        read_carmen(tmp_path / "a.log")


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"angle_inc_deg": "wide"}',
        '{"angle_inc_deg": 0}',
        '{"no_return_at_or_above_m": -1}',
        '{"angle_min_deg": -90}',
        '{"angle_min_deg": NaN, "angle_inc_deg": 1}',
    ],
)
def test_a_file_beside_the_log_that_makes_no_sense_is_an_error(tmp_path, text):
    path = write(tmp_path / "a.log", scans(1))
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(LogError, match=r"a\.json"):
        read_carmen(path)


def test_names_lose_their_endings(tmp_path):
    for name in ("intel.log.gz", "intel.log", "intel.clf", "intel"):
        assert log_name(tmp_path / name) == "intel"
