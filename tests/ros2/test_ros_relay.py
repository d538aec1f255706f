"""The relay sends what was kept while a decision is late."""

import time

from foresee_navigator.relay import Relay

from foresee.mapping.commands import TwistCommand

COMMANDS = [TwistCommand(speed, 0.0) for speed in (0.9, 0.8, 0.7)]


def test_a_decision_in_time_leaves_nothing_to_send():
    sent = []
    with Relay(sent.append, COMMANDS, tick=5.0) as relay:
        pass
    assert (relay.sent, sent) == (0, [])


def test_while_a_decision_is_late_a_command_is_sent_at_the_end_of_each_tick():
    sent = []
    with Relay(lambda command: sent.append((time.monotonic(), command)), COMMANDS, 0.05) as relay:
        started = time.monotonic()
        while len(sent) < 2:
            time.sleep(0.001)
    count = relay.sent
    assert [command for _, command in sent] == COMMANDS[:count]
    for number, (when, _) in enumerate(sent, start=1):
        assert when - started > 0.05 * number - 0.01


def test_no_more_is_sent_than_there_is():
    sent = []
    with Relay(sent.append, COMMANDS[:1], tick=0.001) as relay:
        while not sent:
            time.sleep(0.001)
    assert (relay.sent, sent) == (1, COMMANDS[:1])
