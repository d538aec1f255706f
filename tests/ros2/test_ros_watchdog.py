"""The watchdog names what is missing or late."""

import pytest
from foresee_navigator.watchdog import Arrival, Watchdog


def watchdog(scan=None, odometry=None):
    dog = Watchdog(("scan", "odometry"), 0.5)
    for name, arrival in (("scan", scan), ("odometry", odometry)):
        if arrival is not None:
            dog.saw(name, Arrival(*arrival))
    return dog


def test_before_the_first_message_all_are_missing():
    assert watchdog().complaints(0.0, 0.0) == ("no scan yet", "no odometry yet")


def test_fresh_messages_are_no_reason_to_complain():
    assert watchdog((1.0, 51.0), (1.2, 51.2)).complaints(1.3, 51.3) == ()


@pytest.mark.parametrize(
    ("time", "clock", "line"),
    [
        # The node's clock may stand, since the simulator that makes it has ended.
        (3.0, 51.0, "no scan for 2.0 s"),
        (1.0, 53.0, "scan is 2.0 s late"),
        (1.0, 49.0, "scan is stamped 2.0 s ahead of this node's clock"),
    ],
)
def test_silence_and_old_and_future_stamps_are_told(time, clock, line):
    dog = watchdog((1.0, 51.0), (time, clock))
    assert dog.complaints(time, clock) == (line,)


def test_it_falls_silent_when_messages_return():
    dog = watchdog((1.0, 1.0), (1.0, 1.0))
    assert len(dog.complaints(5.0, 5.0)) == 2
    dog.saw("scan", Arrival(5.0, 5.0))
    assert dog.complaints(5.0, 5.0) == ("no odometry for 4.0 s",)
    dog.saw("odometry", Arrival(5.0, 5.0))
    assert dog.complaints(5.0, 5.0) == ()


def test_an_unknown_input_is_refused():
    with pytest.raises(KeyError, match="they are scan, odometry"):
        watchdog().saw("imu", Arrival(0.0, 0.0))
