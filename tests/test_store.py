"""A run on disk: each drive is there once, whenever it was packed, and whoever was interrupted."""

import subprocess
import sys

import numpy as np
import pytest

from benchmarks import store
from benchmarks.settings import Settings, UsageError
from benchmarks.store import Store, several_states

TWO = Settings(episodes=2, arms=("known",))


def driven(index, arm):
    """A drive that nobody drove: its result and trace."""
    result = {
        "arm": arm, "vehicle": "dubins", "index": index, "world": f"w{index % 5}", "seed": index,
        "start": [], "goal": [], "outcome": "reached", "time": 10.0, "t_opt": None,
        "path_length": 20.0 + index % 7,
        "mean_speed": 2.0, "max_speed": 3.0, "min_clearance": 0.5, "stops": 0,
        "impact_speed": None, "promises": 1, "promises_broken": 0, "faults": {},
        "paths": {}, "cycle_ms": [1.0, 2.0],
    }  # fmt: skip
    return result, {f"e{index}/{arm}/states": np.array([index, len(arm)]),
                    f"w{index}/cells": np.array([index])}  # fmt: skip


def keys(episodes):
    return [(e["index"], e["arm"]) for e in episodes]


def test_thousands_of_drives_are_packed_in_pieces_and_each_is_there_once(tmp_path):
    arms, count = ("known", "oracle"), 1000
    everything = [(index, arm) for index in range(count) for arm in arms]
    # As they may end: in no order, and some of them after an interrupt.
    ending = [everything[i] for i in np.random.default_rng(0).permutation(len(everything))]
    for piece in (ending[:1200], ending[1200:1900], ending[1900:]):
        with Store(tmp_path, Settings(episodes=count, arms=arms), None) as run:
            assert not run.done() & set(piece)
            for key in piece:
                run.add(*driven(*key))
            results = run.pack()
    assert keys(results["episodes"]) == everything
    assert results["episodes"] == [driven(*key)[0] for key in everything]
    assert results["unused"] == []
    assert results["summary"]["oracle"]["episodes"] == count
    assert not list((tmp_path / "parts").glob("*.npz"))
    with np.load(tmp_path / "traces.npz") as traces:
        assert len(traces.files) == len(set(traces.files)) == len(everything) + count
        for index, arm in everything[::37]:
            assert traces[f"e{index}/{arm}/states"].tolist() == [index, len(arm)]
            assert traces[f"w{index}/cells"].tolist() == [index]


def test_drives_that_are_not_asked_for_any_more_are_kept(tmp_path):
    with Store(tmp_path, Settings(episodes=3, arms=("known", "oracle")), None) as run:
        for index in range(3):
            for arm in ("known", "oracle"):
                run.add(*driven(index, arm))
        run.pack()
    with Store(tmp_path, Settings(episodes=2, arms=("oracle",)), None) as fewer:
        assert keys(fewer.pack()["episodes"]) == [(0, "oracle"), (1, "oracle")]
    with Store(tmp_path, Settings(episodes=3, arms=("oracle", "known")), None) as again:
        assert len(again.done()) == 6
        assert keys(again.pack()["episodes"])[:2] == [(0, "oracle"), (0, "known")]


def interrupted(*_):
    raise KeyboardInterrupt


def test_a_drive_that_was_written_but_not_noted_is_there_the_next_time(tmp_path, monkeypatch):
    plain = store.write_whole

    def written(path, data):
        plain(path, data)
        raise KeyboardInterrupt

    with Store(tmp_path, TWO, None) as run:
        run.add(*driven(0, "known"))
        with monkeypatch.context() as patched:
            patched.setattr(store, "write_whole", written)
            with pytest.raises(KeyboardInterrupt):
                run.add(*driven(1, "known"))
        assert keys(run.pack()["episodes"]) == [(0, "known")]
    with Store(tmp_path, TWO, None) as run:
        assert keys(run.pack()["episodes"]) == [(0, "known"), (1, "known")]


def test_a_run_that_is_stopped_while_it_packs_loses_nothing(tmp_path, monkeypatch):
    files = [tmp_path / name for name in ("results.json", "traces.npz")]
    with Store(tmp_path, TWO, None) as run:
        run.add(*driven(0, "known"))
        run.pack()
        run.add(*driven(1, "known"))
        before = [path.read_bytes() for path in files]
        with monkeypatch.context() as patched:
            patched.setattr(store.os, "replace", interrupted)
            with pytest.raises(KeyboardInterrupt):
                run.pack()
    assert [path.read_bytes() for path in files] == before
    with Store(tmp_path, TWO, None) as run:
        assert keys(run.pack()["episodes"]) == [(0, "known"), (1, "known")]
    with np.load(tmp_path / "traces.npz") as traces:
        assert {"e0/known/states", "e1/known/states"} <= set(traces.files)


def test_a_folder_is_of_one_run_at_a_time(tmp_path):
    with Store(tmp_path, TWO, None) as run:
        run.add(*driven(0, "known"))
        with pytest.raises(UsageError, match="another run is at work"):
            Store(tmp_path, TWO, None)
        run.add(*driven(1, "known"))
    with Store(tmp_path, TWO, None) as run:
        assert run.done() == {(0, "known"), (1, "known")}


HOLD = """
import sys
from pathlib import Path
from benchmarks.settings import Settings
from benchmarks.store import Store

run = Store(Path(sys.argv[1]), Settings(episodes=2, arms=("known",)), None)
print("at work", flush=True)
sys.stdin.read()
"""


def test_a_run_that_was_killed_keeps_nobody_out(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True) as holder:  # fmt: skip
        assert holder.stdout.readline() == "at work\n"
        with pytest.raises(UsageError, match="another run is at work"):
            Store(tmp_path, TWO, None)
        holder.kill()
    with Store(tmp_path, TWO, None) as run:
        assert run.done() == set()


def test_results_of_several_states_of_the_code_are_told():
    assert "these drives come from 2 states" in several_states(["a", "b", "a"], "drives")
    assert "2 states" in several_states(["a", None], "scores")
    assert several_states(["a", "a"], "drives") == several_states([], "drives") == ""
