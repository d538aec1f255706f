"""A command works and ends with its status whatever its standard streams are."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tqdm import tqdm

from foresee.infra.streams import lasting_streams

ROOT = Path(__file__).resolve().parents[2]
COMMAND = """\
import sys
from foresee.infra.command_line import Command, UsageError

def run():
    print("level \\u03bb, 0.0\\u20136.0 %")
    print("progress", file=sys.stderr, flush=True)
    if "fails" in sys.argv:
        raise UsageError("no file")

sys.exit(Command("command", None, run)([]))
"""
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def shell(line, **variables):
    """Run a line of the shell, in which `command` is a command, and $BROKEN a broken pipe."""
    line = line.replace("command", f'{sys.executable} -c "$CODE"')
    line = line.replace("foresee", f"{sys.executable} -m foresee")
    reader, broken = os.pipe()
    os.close(reader)
    variables = {"CODE": COMMAND, "BROKEN": str(broken), "PYTHONPATH": str(ROOT), **variables}
    try:
        return subprocess.run(
            ["bash", "-c", line],
            capture_output=True,
            env=os.environ | variables,
            pass_fds=[broken],
        )
    finally:
        os.close(broken)


@pytest.mark.parametrize(
    "variables", [C_LOCALE, {"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1"}]
)
def test_characters_that_the_output_lacks_are_transliterated(variables):
    done = shell("command", **variables)
    assert (done.returncode, done.stderr) == (0, b"progress\n")
    assert done.stdout == b"level lambda, 0.0-6.0 %\n"


@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("command >&-", 0),
        ("command <&- >&- 2>&-", 0),
        ("command fails 2>&-", 2),
        ("command 2>/dev/full", 0),
        ("command 2>&$BROKEN", 0),
        ("command fails 2>&$BROKEN", 2),
        ("command >/dev/full", 1),
        ("command >&$BROKEN", 1),
        ("foresee tables --help >&$BROKEN", 0),
        ("foresee >/dev/full", 1),
    ],
)
def test_a_stream_that_is_closed_or_broken_gives_the_right_status_and_no_traceback(line, status):
    done = shell(line)
    assert done.returncode == status
    assert b"Traceback" not in done.stderr
    assert b"Exception" not in done.stderr


def test_streams_are_restored_and_file_names_that_are_no_text_keep_their_bytes(capfdbinary):
    before = sys.stderr
    with lasting_streams():
        print("map-\udcff", file=sys.stderr)
    assert sys.stderr is before
    assert capfdbinary.readouterr().err == b"map-\xff\n"


def test_a_progress_bar_lives_without_stderr(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    with lasting_streams():
        assert list(tqdm(range(3))) == [0, 1, 2]
