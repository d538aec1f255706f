"""Bags of ROS 1 and ROS 2, written here and read back."""

import math

import numpy as np
import pytest

from predictor.data.bag_config import BagConfig
from predictor.data.bags import is_bag, read_bag
from predictor.data.frames import Frames
from predictor.data.laser_log import LogError
from predictor.data.log_files import read_log
from predictor.data.transforms import Transforms
from predictor.dataset import main

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from rosbags import rosbag2
from written_bags import LASER_AT, TURN, Bag, turn

ROS = [1, 2]


def bag(tmp_path, ros):
    return Bag(tmp_path / ("site.bag" if ros == 1 else "site"), ros)


def laser(x, y, yaw):
    """The laser's pose for the robot's."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return (
        x + cos * LASER_AT[0] - sin * LASER_AT[1],
        y + sin * LASER_AT[0] + cos * LASER_AT[1],
        yaw + TURN,
    )


@pytest.mark.parametrize("ros", ROS)
def test_poses_come_through_tf_at_the_scans_own_times(tmp_path, ros):
    with bag(tmp_path, ros) as out:
        out.mount()
        for time in (10.0, 11.0, 12.0):
            # The map has moved against the odometry, as it does when a loop is closed.
            out.transform(time, "map", "odom", (1.0, time - 10.0, 0.0), turn(0.0))
            out.transform(
                time, "odom", "base_link", (time - 10.0, 0.0, 0.0), turn(3.0 + 0.2 * (time - 10.0))
            )
        for time in (10.0, 10.25, 11.5):
            out.scan(time)
    log = read_bag(out.path)
    assert log.name == "site"
    assert log.times is not None
    assert log.times == pytest.approx([10.0, 10.25, 11.5])
    for pose, time in zip(log.poses, log.times - 10.0, strict=True):
        wanted = laser(1.0 + time, time, 3.0 + 0.2 * time)
        assert pose[:2] == pytest.approx(wanted[:2], abs=1e-6)
        assert math.remainder(pose[2] - wanted[2], 2 * math.pi) == pytest.approx(0, abs=1e-6)
    scan = log.scans[0]
    assert scan.ranges == pytest.approx([2.0, 3.0, 4.0])
    assert (scan.angle_min, scan.angle_increment) == pytest.approx((-0.5, 0.5))
    assert scan.range_max == 25.0


@pytest.mark.parametrize("ros", ROS)
@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped", "Odometry"])
def test_a_topic_of_poses_says_where_the_robot_is(tmp_path, ros, kind):
    with bag(tmp_path, ros) as out:
        out.mount()
        out.pose(1.0, 0.0, 5.0, 3.0, kind)
        # The short way from 3 to -3 rad is through π.
        out.pose(2.0, 2.0, 5.0, -3.0, kind)
        out.scan(1.5)
    log = read_bag(out.path)
    wanted = laser(1.0, 5.0, math.pi)
    assert log.poses[0, :2] == pytest.approx(wanted[:2], abs=1e-6)
    assert math.remainder(log.poses[0, 2] - wanted[2], 2 * math.pi) == pytest.approx(0, abs=1e-6)


def test_poses_are_the_lasers_own_where_nothing_says_how_it_is_mounted(tmp_path):
    with bag(tmp_path, 2) as out:
        for time in (1.0, 2.0):
            out.pose(time, time, 0.0, 0.5)
        out.scan(1.5)
    log = read_bag(out.path)
    assert log.poses[0] == pytest.approx([1.5, 0.0, 0.5])
    assert "no static transform says where laser 'laser' is" in log.notes[0]


def test_scans_without_a_pose_are_skipped_and_counted(tmp_path):
    with bag(tmp_path, 2) as out:
        out.pose(1.0, 0.0, 0.0, 0.0)
        out.pose(2.0, 1.0, 0.0, 0.0)
        for time in (0.5, 1.0, 1.7, 2.4, 3.0):
            out.scan(time)
    log = read_bag(out.path)
    assert len(log) == 2
    assert log.skipped["scans without a pose"] == 3


def test_where_a_localiser_was_lost_for_long_nothing_is_interpolated(tmp_path):
    with bag(tmp_path, 2) as out:
        for time in (1.0, 2.0, 9.0, 9.5):
            out.pose(time, time, 0.0, 0.0)
        for time in (1.5, 2.0, 2.5, 8.9, 9.0, 9.2):
            out.scan(time)
    log = read_bag(out.path)
    assert log.poses[:, 0] == pytest.approx([1.5, 2.0, 9.0, 9.2])
    assert log.skipped["scans without a pose"] == 2


@pytest.mark.parametrize("ros", ROS)
def test_ranges_that_are_none_say_nothing_and_are_counted(tmp_path, ros):
    ranges = [math.nan, -1.0, 0.1, 5.0, math.inf, 30.0]
    with bag(tmp_path, ros) as out:
        for time in (1.0, 2.0):
            out.pose(time, 0.0, 0.0, 0.0)
        out.scan(1.5, ranges)
    log = read_bag(out.path)
    assert log.skipped["bad ranges"] == 2
    # Too near for the sensor is no return; too far is one that says: free up to there.
    assert np.isnan(log.scans[0].ranges).tolist() == [True, True, True, False, False, False]


def test_a_laser_that_hangs_upside_down_turns_the_other_way(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount(roll=math.pi)
        for time in (1.0, 2.0):
            out.pose(time, 0.0, 0.0, 0.0)
        out.scan(1.5)
    log = read_bag(out.path)
    assert log.poses[0, 2] == pytest.approx(TURN)
    assert log.scans[0].angle_min == pytest.approx(0.5)
    assert log.scans[0].angle_increment == pytest.approx(-0.5)


def test_a_laser_that_leans_is_refused(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount(roll=0.5)
        for time in (1.0, 2.0):
            out.pose(time, 0.0, 0.0, 0.0)
        out.scan(1.5)
    with pytest.raises(LogError, match="leans by more than 10°"):
        read_bag(out.path)


@pytest.mark.parametrize("ros", ROS)
def test_a_bag_without_scans_lists_its_topics(tmp_path, ros):
    with bag(tmp_path, ros) as out:
        out.pose(1.0, 0.0, 0.0, 0.0, topic="/amcl_pose")
    with pytest.raises(LogError, match=r"has no scans; topics: /amcl_pose \(geometry_msgs"):
        read_bag(out.path)


@pytest.mark.parametrize("ros", ROS)
def test_a_bag_without_poses_lists_its_topics(tmp_path, ros):
    with bag(tmp_path, ros) as out:
        out.scan(1.0)
    with pytest.raises(LogError, match=r"has no poses; topics: /scan \(sensor_msgs"):
        read_bag(out.path)


def test_of_several_topics_one_must_be_chosen(tmp_path):
    with bag(tmp_path, 2) as out:
        for time in (1.0, 2.0):
            out.pose(time, 7.0, 0.0, 0.0, topic="/amcl")
            out.pose(time, 0.0, 0.0, 0.0, "Odometry", "/odom")
            out.scan(time, topic="/front")
            out.scan(time, topic="/back")
    with pytest.raises(LogError, match="several topics of scans: /back, /front; choose one"):
        read_bag(out.path)
    with pytest.raises(LogError, match="several topics of poses: /amcl, /odom; choose one"):
        read_bag(out.path, BagConfig(scans="/front"))
    assert read_bag(out.path, BagConfig("/front", "/amcl")).poses[0, 0] == 7.0
    with pytest.raises(LogError, match="/side is no topic of scans; topics: /amcl"):
        read_bag(out.path, BagConfig("/side", "/amcl"))


def test_a_map_frame_that_is_asked_for_is_not_replaced_by_a_topic_of_poses(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount()
        for time in (1.0, 2.0):
            out.transform(time, "odom", "base_link", (time, 0.0, 0.0), turn(0.0))
            out.pose(time, time, 0.0, 0.0)
            out.scan(time)
    assert len(read_bag(out.path).poses) == 2
    with pytest.raises(LogError, match="not to 'zz'"):
        read_bag(out.path, BagConfig(map_frame="zz"))


def test_a_folder_that_is_no_bag_is_named(tmp_path):
    with pytest.raises(LogError, match=r"folder without metadata\.yaml"):
        read_log(tmp_path)


def test_a_tree_that_does_not_know_the_map_says_what_it_knows(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount()
        for time in (1.0, 2.0):
            out.transform(time, "odom", "base_link", (time, 0.0, 0.0), turn(0.0))
            out.scan(time)
    for config in (BagConfig(), BagConfig(poses="/tf")):
        with pytest.raises(LogError, match=r"laser to base_link, odom, not to 'map'; --map-frame"):
            read_bag(out.path, config)
    log = read_bag(out.path, BagConfig(poses="/tf", map_frame="odom"))
    assert log.poses[:, 0] == pytest.approx([1.3, 2.3])


def test_a_sensor_without_a_range_is_refused(tmp_path):
    with bag(tmp_path, 2) as out:
        out.scan(1.0, longest=0.0)
    with pytest.raises(LogError, match=r"/scan gives a range_max of 0\.0 m"):
        read_bag(out.path)


@pytest.mark.parametrize("step", [0.0, math.nan])
def test_beams_that_look_nowhere_are_refused(tmp_path, step):
    with bag(tmp_path, 2) as out:
        out.scan(1.0, step=step)
    with pytest.raises(LogError, match=rf"/scan has beams from -0\.5 rad on, {step} rad apart"):
        read_bag(out.path)


@pytest.mark.parametrize("ros", ROS)
@pytest.mark.parametrize("poses", ["tf", "topic"])
def test_each_scan_of_several_lasers_on_a_topic_has_the_pose_of_its_own(tmp_path, ros, poses):
    with bag(tmp_path, ros) as out:
        out.mount()
        out.transform(0.0, "base_link", "rear", (-0.5, 0.0, 0.1), turn(math.pi), "/tf_static")
        if poses == "tf":
            out.drive()
        else:
            for time in (1.0, 2.0, 3.0):
                out.pose(time, time, 0.0, 0.0)
        for time in (1.0, 1.5, 2.0, 2.5):
            out.scan(time, frame="laser" if time % 1 == 0 else "rear")
    log = read_bag(out.path)
    for pose, time in zip(log.poses, (1.0, 1.5, 2.0, 2.5), strict=True):
        wanted = laser(time, 0.0, 0.0) if time % 1 == 0 else (time - 0.5, 0.0, math.pi)
        assert pose[:2] == pytest.approx(wanted[:2], abs=1e-6)
        assert math.remainder(pose[2] - wanted[2], 2 * math.pi) == pytest.approx(0, abs=1e-6)


def test_lasers_that_nothing_fixes_to_one_robot_are_refused(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount()
        out.pose(1.0, 0.0, 0.0, 0.0)
        for frame in ("laser", "rear"):
            out.scan(1.0, frame=frame)
    with pytest.raises(LogError, match="several frames, laser, rear, and no transform fixes"):
        read_bag(out.path)


@pytest.mark.parametrize("stopped", [0.0, 77.0])
@pytest.mark.parametrize("poses", ["tf", "topic"])
def test_where_the_stamps_stand_still_the_bags_own_times_are_used_and_said(
    tmp_path, stopped, poses
):
    with bag(tmp_path, 2) as out:
        out.mount()
        out.stopped = stopped
        if poses == "tf":
            out.drive()
        else:
            for time in (1.0, 2.0, 3.0):
                out.pose(time, time, 0.0, 0.0)
        for time in (1.25, 2.0, 2.75):
            out.scan(time)
    log = read_bag(out.path)
    assert log.times == pytest.approx([1.25, 2.0, 2.75])
    assert log.poses[:, 0] == pytest.approx([1.55, 2.3, 3.05])
    topic = "/tf" if poses == "tf" else "/pose"
    assert [line.partition(":")[0] for line in log.notes] == [
        f"the stamps of {name} are all {stopped:g} s" for name in ("/scan", topic)
    ]


def test_a_scan_that_repeats_the_time_of_the_last_one_is_skipped_and_counted(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount()
        out.drive()
        for time in (1.0, 1.5, 1.5, 1.5, 2.0):
            out.scan(time)
        out.transform(0.0, "base_link", "rear", (-0.5, 0.0, 0.1), turn(0.0), "/tf_static")
        out.scan(1.5, frame="rear")
    log = read_bag(out.path)
    assert log.times == pytest.approx([1.0, 1.5, 1.5, 2.0])
    assert log.skipped["scans that repeat a time"] == 2


@pytest.mark.parametrize("ros", ROS)
def test_transforms_in_a_namespace_are_read(tmp_path, ros):
    with bag(tmp_path, ros) as out:
        out.mount(topic="/robot1/tf_static")
        out.drive(topic="/robot1/tf")
        for time in (1.0, 1.5, 2.0, 2.5):
            out.scan(time, topic="/robot1/scan")
    log = read_bag(out.path)
    assert log.poses[:, 0] == pytest.approx([1.3, 1.8, 2.3, 2.8])
    assert log.skipped["scans without a pose"] == 0


def test_of_several_robots_the_transforms_of_the_one_with_the_scans_are_read(tmp_path):
    with bag(tmp_path, 2) as out:
        for number, offset in ((1, 0.0), (2, 50.0)):
            out.mount(topic=f"/robot{number}/tf_static")
            for time in (1.0, 2.0):
                where = (time + offset, 0.0, 0.0)
                out.transform(time, "map", "base_link", where, turn(0.0), f"/robot{number}/tf")
            out.scan(1.5, topic=f"/robot{number}/scan")
        out.scan(1.5, topic="/scan")
    for number, x in ((1, 1.8), (2, 51.8)):
        log = read_bag(out.path, BagConfig(scans=f"/robot{number}/scan"))
        assert log.poses[0, 0] == pytest.approx(x)
    with pytest.raises(LogError, match="transforms are of several robots"):
        read_bag(out.path, BagConfig(scans="/scan"))


@pytest.mark.parametrize("ros", ROS)
def test_scans_without_beams_are_skipped_and_counted(tmp_path, ros):
    with bag(tmp_path, ros) as out:
        out.mount()
        out.drive()
        for time in (1.0, 1.5, 2.0, 2.5):
            out.scan(time, ranges=() if time == 1.5 else (2.0, 3.0))
        out.scan(2.6, longest=math.nan)
        out.scan(2.7, step=0.0)
    log = read_bag(out.path)
    assert log.times == pytest.approx([1.0, 2.0, 2.5])
    assert log.skipped["bad scans"] == 3


def test_a_bag_whose_scans_all_lack_beams_says_so(tmp_path):
    with bag(tmp_path, 2) as out:
        out.scan(1.0, ranges=())
    with pytest.raises(LogError, match="/scan has scans without ranges"):
        read_bag(out.path)


@pytest.mark.parametrize("bad", [(math.nan,) * 4, (0.0,) * 4, (0.0, 0.0, math.inf, 1.0)])
@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_a_transform_that_is_none_loses_nothing_else(tmp_path, bad, topic):
    parents = {"/tf": ("map", "base_link"), "/tf_static": ("base_link", "laser")}
    with bag(tmp_path, 2) as out:
        out.mount()
        out.drive()
        out.transform(1.5, *parents[topic], (9.0, 9.0, 0.0), bad, topic)
        for time in (1.0, 1.5, 2.0):
            out.scan(time)
    log = read_bag(out.path)
    assert log.poses[:, 0] == pytest.approx([1.3, 1.8, 2.3])
    assert log.skipped["bad transforms"] == 1


def test_a_laser_that_nothing_connects_is_named_with_the_frames_there_are(tmp_path):
    with bag(tmp_path, 2) as out:
        out.drive()
        out.scan(1.5)
    with pytest.raises(LogError, match=r"\(base_link, map\), and .* no /tf_static"):
        read_bag(out.path)


def test_a_frame_with_two_parents_is_known_through_either(tmp_path):
    with bag(tmp_path, 2) as out:
        out.mount()
        for time in (1.0, 1.5, 2.0, 2.5, 3.0):
            parent = "odom" if time % 1 else "map"
            out.transform(time, parent, "base_link", (time, 0.0, 0.0), turn(0.0))
        for time in (1.0, 2.5):
            out.scan(time)
    assert read_bag(out.path).poses[:, 0] == pytest.approx([1.3, 2.8])


def test_a_compressed_file_is_read_as_its_folder_or_refused_in_one_line(tmp_path):
    folder = tmp_path / "site"
    modes = rosbag2.CompressionMode.FILE, rosbag2.CompressionFormat.ZSTD
    out = bag(tmp_path, 2)
    out.writer.set_compression(*modes)
    with out:
        out.pose(1.0, 0.0, 0.0, 0.0)
        out.scan(1.0)
    (packed,) = (path for path in folder.iterdir() if path.suffix == ".zstd")
    assert len(read_log(packed)) == len(read_log(folder)) == 1
    for name in (packed.name, "a.bag.gz", "b.mcap.zst", "c.db3.bz2"):
        alone = tmp_path / name
        alone.write_bytes(packed.read_bytes())
        with pytest.raises(LogError, match="is a compressed bag: unpack it, or give") as caught:
            read_log(alone)
        assert "\n" not in str(caught.value)


def test_a_bag_of_ros_2_that_is_cut_off_is_an_error(tmp_path):
    with bag(tmp_path, 2) as out:
        for time in range(200):
            out.scan(float(time))
    (stored,) = (path for path in out.path.iterdir() if path.suffix in (".db3", ".mcap"))
    stored.write_bytes(stored.read_bytes()[: stored.stat().st_size // 2])
    with pytest.raises(LogError, match="cannot be read as a bag"):
        read_bag(out.path)


def test_the_command_makes_a_set_of_a_bag(tmp_path, capsys):
    with bag(tmp_path, 2) as out:
        for time in (1.0, 1.4, 1.8, 2.2, 2.6):
            out.pose(time, time, 0.0, 0.0)
            out.scan(time + 0.1, np.linspace(2.0, 4.0, 90), step=0.02)
    folder = tmp_path / "set"
    assert main(["--log", str(out.path), "--out", str(folder), "--jobs", "1"]) == 0
    assert "skipped: 1 scans without a pose" in capsys.readouterr().err
    frames = Frames.load(folder, "physical")
    assert len(frames) == 4
    assert frames.about[0]["map"] == "site"
    assert (frames.estimated[-1] != 2).any()


def test_damaged_and_missing_bags_are_errors_of_one_line(tmp_path):
    with bag(tmp_path, 1) as out:
        for time in range(200):
            out.scan(float(time))
    out.path.write_bytes(out.path.read_bytes()[:-100])
    with pytest.raises(LogError, match="cannot be read as a bag") as caught:
        read_bag(out.path)
    assert "\n" not in str(caught.value)
    (tmp_path / "empty.bag").write_bytes(b"")
    with pytest.raises(LogError, match="cannot be read as a bag"):
        read_bag(tmp_path / "empty.bag")
    with pytest.raises(LogError, match="no such file"):
        read_bag(tmp_path / "none.bag")


def test_bags_are_told_from_other_logs(tmp_path):
    with bag(tmp_path, 2) as out:
        out.scan(1.0)
    assert is_bag(out.path)
    assert is_bag(tmp_path / "a.bag")
    assert not is_bag(tmp_path / "intel.log.gz")
    assert not is_bag(tmp_path)


def test_a_turn_between_two_transforms_takes_the_short_way():
    tree = Transforms()
    tree.add("map", "base", 0.0, (0, 0, 0), turn(3.0))
    tree.add("map", "base", 1.0, (2, 0, 0), turn(-3.0))
    positions, turns, known = tree.look_up("map", "base", np.array([-1.0, 0.5, 2.0]))
    assert known.tolist() == [False, True, False]
    assert positions[1] == pytest.approx([1, 0, 0])
    assert abs(turns[1].as_euler("zyx")[0]) == pytest.approx(math.pi)


def test_a_tree_that_runs_in_a_circle_ends():
    tree = Transforms()
    tree.add("a", "b", 0.0, (0, 0, 0), turn(0.0), fixed=True)
    tree.add("b", "a", 0.0, (0, 0, 0), turn(0.0), fixed=True)
    assert tree.carrier("a") in "ab"
    with pytest.raises(KeyError):
        tree.look_up("map", "a", np.zeros(1))
