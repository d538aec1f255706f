"""Interruptions at random moments: that damage, left processes and tracebacks are noticed."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from benchmarks.studies.robustness import interrupt, interruptions

COUNTS = """
import json, sys, time
from pathlib import Path
out = Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir(parents=True, exist_ok=True)
path = out / "results.json"
found = json.loads(path.read_text()) if path.exists() else {"values": [], "seconds": 0.0}
try:
    while len(found["values"]) < 10:
        time.sleep(0.1)
        found["values"].append(len(found["values"]))
        found["seconds"] = time.time()
        (out / "part").write_text(json.dumps(found))
        (out / "part").replace(path)
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.fixture
def case(tmp_path, monkeypatch):
    """A command that counts to ten, and a function that writes what it does."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(interruptions, "CASES", {"counting": ""})
    monkeypatch.setattr(interruptions, "INPUTS", {})

    def write(program):
        (tmp_path / "counting.py").write_text(program)
        return interruptions.references(tmp_path, interruptions.CASES)

    return write


@pytest.mark.parametrize("kind", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_command_that_goes_on_where_it_was_has_the_same_results(tmp_path, case, kind):
    seconds = case(COUNTS)
    # Early, since the machine may have been busier while the reference was made.
    found = interruptions.interrupted(tmp_path, None, seconds, (0, "counting", kind, 0.2))
    assert found["interrupted"]
    assert found["status"] != 0
    assert found["status again"] == 0
    assert found["differences"] == []
    assert not (tmp_path / "trial-0").exists()


def test_results_that_differ_and_tracebacks_are_found(tmp_path, case):
    seconds = case(COUNTS)
    (tmp_path / "counting.py").write_text(COUNTS.replace("< 10", "< 9") + "raise OSError\n")
    found = interruptions.interrupted(tmp_path, None, seconds, (0, "counting", "SIGKILL", 1e3))
    assert not found["interrupted"]
    assert found["traceback"]
    assert found["status again"] == 1
    assert found["differences"] == ["results.json"]
    assert (tmp_path / "trial-0").exists()


def test_times_are_no_difference_and_values_are(tmp_path):
    for name, value, seconds in (("one", 1, 0.1), ("two", 1, 0.2), ("three", 2, 0.1)):
        (tmp_path / name).mkdir()
        text = json.dumps({"drives": [{"value": value, "seconds": seconds}]})
        (tmp_path / name / "results.json").write_text(text)
        np.savez(
            tmp_path / name / "traces.npz", **{"e0/x": np.full(3, value), "e0/cycle_ms": seconds}
        )
    one, two, three = (interruptions.contents(tmp_path / n) for n in ("one", "two", "three"))
    assert interruptions.differences(one, two) == []
    assert interruptions.differences(one, three) == ["results.json", "traces.npz:e0/x"]
    (tmp_path / "two" / "traces.npz").unlink()
    assert interruptions.differences(one, interruptions.contents(tmp_path / "two")) == [
        "traces.npz:e0/x"
    ]


def test_processes_that_do_not_end_are_counted_and_killed(monkeypatch):
    monkeypatch.setattr(interruptions, "GONE", 0.3)
    sleeps = "[sys.executable, '-c', 'import time; time.sleep(60)']"
    child = f"import subprocess, sys; subprocess.Popen({sleeps})"
    process = subprocess.Popen([sys.executable, "-c", child], start_new_session=True)
    process.wait()
    assert interruptions._left_behind(process.pid) == 1
    end = time.monotonic() + 5
    while interruptions._members(process.pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert interruptions._left_behind(process.pid) == 0


def test_a_folder_that_is_no_file_system_of_its_own_is_not_filled(tmp_path, capsys):
    assert interrupt.main(["--disk", str(tmp_path)]) == 2
    assert "no file system of its own" in capsys.readouterr().err
    assert os.listdir(tmp_path) == []
