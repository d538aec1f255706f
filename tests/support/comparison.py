"""The command of comparisons, run by tests, and what it wrote."""

import json
import subprocess
import sys

import numpy as np

from benchmarks.corridor import main


def run(*words) -> int:
    """The exit status of a command line."""
    try:
        return main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)


def python(*words, cwd):
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def results(out):
    return json.loads((out / "results.json").read_text())


def untimed(episodes):
    """Episodes without what depends on the clock."""
    return [{k: v for k, v in e.items() if k != "cycle_ms"} for e in episodes]


def assert_same_drives(a, b):
    """Two runs have the same episodes and traces, but for what depends on the clock."""
    assert untimed(results(a)["episodes"]) == untimed(results(b)["episodes"])
    with np.load(a / "traces.npz") as one, np.load(b / "traces.npz") as other:
        assert set(one.files) == set(other.files)
        for name in one.files:
            if not name.endswith("/times"):
                assert np.array_equal(one[name], other[name]), name
