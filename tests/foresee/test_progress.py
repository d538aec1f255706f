"""Progress is a bar in a terminal, and sparse lines in a log file."""

import io
import sys

from foresee.infra import progress
from foresee.infra.command_line import Command


class Terminal(io.StringIO):
    def isatty(self):
        return True


def work():
    with progress.progress(total=500, unit="drive") as bar:
        for number in range(500):
            bar.set_postfix_str(f"number {number}", refresh=False)
            bar.update()
        bar.write("warning: one is missing", file=sys.stderr)


def written_to(stream, monkeypatch):
    """What a command writes to a stderr."""
    monkeypatch.setattr(sys, "stderr", stream)
    assert Command("work", None, work)([]) == 0
    return stream.getvalue()


def test_a_terminal_gets_a_bar(monkeypatch):
    assert written_to(Terminal(), monkeypatch).count("\r") > 1


def test_a_log_file_gets_a_line_at_the_start_and_at_the_end_and_messages_in_between(monkeypatch):
    said = written_to(io.StringIO(), monkeypatch)
    first, message, last = said.splitlines()
    assert first.startswith("0%")
    assert message == "warning: one is missing"
    assert last.startswith("100%")
    assert last.endswith("number 499]")
    assert said.replace("\n", "").isprintable()


def test_a_log_file_gets_further_lines_where_time_has_passed(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setattr(progress, "SPARSE", 0.0)
    assert list(progress.progress(range(3), desc="name")) == [0, 1, 2]
    shown = [line.split("|")[0] for line in sys.stderr.getvalue().splitlines()]
    assert shown[:3] == ["name:   0%", "name:  33%", "name:  67%"]
    assert shown[-1] == "name: 100%"
