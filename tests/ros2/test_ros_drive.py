"""The nodes drive a simulated robot over DDS, and stop it when data are missing."""

import signal

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install -e '.[ros2]'")

from ros_stage import Stage

pytestmark = pytest.mark.slow(30)

ERROR = 2


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """The navigator in a process of its own, warm, on the clock of a simulator."""
    log = tmp_path_factory.mktemp("ros") / "log"
    made = Stage(log)
    words = {"predictor": "extend", "use_sim_time": "true", "timeout": "2.0", "range_error": "0.03"}
    options = [word for pair in words.items() for word in ("-p", ":=".join(pair))]
    relayed = ("-r", "scan:=relayed/scan", "-r", "odom:=relayed/odom")
    try:
        with made.process("navigator_node", *options, *relayed):
            made.wait_for(lambda: "ready: warmed up in" in log.read_text(), "it is not ready")
            yield made
    finally:
        made.close()


@pytest.fixture
def robot(stage, short_map):
    """Starts a simulated robot in a straight of 20 m."""
    words = {"world": str(short_map), "length": "10.0", "clock": "true", "beams": "271"}
    options = [word for pair in words.items() for word in ("-p", ":=".join(pair))]
    stage.outcomes.clear()
    stage.delay, stage.scans_to_drop = 0.0, 0
    return lambda: stage.process("simulator_node", *options)


def drives(report):
    return report[2]["mode"] == "drives"


def wait_until_it_drives(stage):
    stage.wait_for_report(lambda r: drives(r) and float(r[2]["speed"]) > 0.5, "it does not drive")


def test_a_corridor_is_driven_to_its_goal(stage, robot):
    with robot():
        stage.wait_for(lambda: "reached the goal" in stage.outcomes, "the goal is not reached")
        stage.wait_for(lambda: stage.speed == 0.0, "it does not stand at the goal")
        assert "collided" not in stage.outcomes
    limits = {report[2]["limit"] for report in stage.reports if drives(report)}
    assert "acceleration" in limits
    assert len(stage.latest["path"].poses) > 2
    for name in ("observed_map", "predicted_map"):
        grid = stage.latest[name]
        assert grid.header.frame_id == "odom"
        assert len(grid.data) == grid.info.width * grid.info.height
        assert -1 <= min(grid.data) <= 20 < 90 < max(grid.data) <= 100


def test_a_dropped_scan_is_no_reason_to_stop_and_late_odometry_is(stage, robot):
    with robot():
        wait_until_it_drives(stage)
        seen = len(stage.reports)
        stage.scans_to_drop = 1
        stage.wait_for(lambda: stage.scans_to_drop == 0, "no scan was dropped")
        # On a busy machine, a pose may be missing for a few ticks; the lost scan never is.
        stage.wait_for(lambda: len(stage.reports) > seen + 4, "no reports")
        wait_until_it_drives(stage)
        since = stage.reports[seen:]
        assert not any("no scan for" in report[2]["missing"] for report in since)

        stage.delay = 4.0
        silent = "stops: no odometry for"
        report = stage.wait_for_report(lambda r: r[1].startswith(silent), "it does not stop")
        assert report[0] == ERROR
        stage.wait_for(lambda: stage.speed == 0.0, "it does not stand")
        assert stage.command == (0.0, 0.0)
        late = stage.wait_for_report(lambda r: "late" in r[2]["missing"], "lateness is not told")
        assert late[1].startswith("stops: odometry is")
        stage.delay = 0.0
        wait_until_it_drives(stage)
        assert "collided" not in stage.outcomes


def test_a_simulator_that_is_killed_and_started_again_stops_the_car_and_it_goes_on(stage, robot):
    with robot() as process:
        wait_until_it_drives(stage)
        stage.wait_for(lambda: stage.seconds >= 4, "the clock stands")
        process.send_signal(signal.SIGKILL)
        both = ("no scan for", "no odometry for")
        report = stage.wait_for_report(
            lambda r: r[0] == ERROR and all(line in r[1] for line in both), "it does not stop"
        )
        # It brakes at the rate of its ticks, although the clock stands: in 2 s, after a timeout of
        # 2 s. One command for each timeout would take 40 s.
        stage.wait_for(lambda: stage.command == (0.0, 0.0), "the command is not to stand", 20.0)
    fresh, back = int(report[2]["fresh_starts"]), stage.times_back
    with robot():
        wait_until_it_drives(stage)
        values = stage.reports[-1][2]
        # If the first seconds of the new clock pass before the nodes find each other, none is new.
        assert int(values["fresh_starts"]) - fresh == stage.times_back - back
        assert "collided" not in stage.outcomes
