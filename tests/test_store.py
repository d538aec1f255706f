"""A run on disk: each drive is there once, whenever it was packed, and whoever was interrupted."""

import json

import numpy as np
import pytest

from benchmarks import store
from benchmarks.settings import Settings
from benchmarks.store import Store


def driven(index, arm):
    """A drive that nobody drove: its result and trace."""
    result = {
        "arm": arm, "index": index, "world": f"w{index % 5}", "seed": index, "start": [],
        "goal": [], "outcome": "reached", "time": 10.0, "path_length": 20.0 + index % 7,
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
        run = Store(tmp_path, Settings(episodes=count, arms=arms), None)
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
    run = Store(tmp_path, Settings(episodes=3, arms=("known", "oracle")), None)
    for index in range(3):
        for arm in ("known", "oracle"):
            run.add(*driven(index, arm))
    run.pack()
    fewer = Store(tmp_path, Settings(episodes=2, arms=("oracle",)), None).pack()
    assert keys(fewer["episodes"]) == [(0, "oracle"), (1, "oracle")]
    again = Store(tmp_path, Settings(episodes=3, arms=("oracle", "known")), None)
    assert len(again.done()) == 6
    assert keys(again.pack()["episodes"])[:2] == [(0, "oracle"), (0, "known")]


def test_a_drive_that_was_written_but_not_noted_is_there_the_next_time(tmp_path, monkeypatch):
    settings, plain = Settings(episodes=2, arms=("known",)), store.write_whole
    run = Store(tmp_path, settings, None)
    run.add(*driven(0, "known"))

    def interrupted(path, data):
        plain(path, data)
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "write_whole", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run.add(*driven(1, "known"))
    monkeypatch.setattr(store, "write_whole", plain)
    assert keys(run.pack()["episodes"]) == [(0, "known")]
    assert keys(Store(tmp_path, settings, None).pack()["episodes"]) == [(0, "known"), (1, "known")]


def test_a_run_that_ends_while_it_packs_loses_nothing(tmp_path, monkeypatch):
    settings = Settings(episodes=2, arms=("known",))
    run = Store(tmp_path, settings, None)
    run.add(*driven(0, "known"))
    run.pack()
    run.add(*driven(1, "known"))
    before = [(tmp_path / name).read_bytes() for name in ("results.json", "traces.npz")]

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(store.os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run.pack()
    assert [(tmp_path / n).read_bytes() for n in ("results.json", "traces.npz")] == before
    assert keys(Store(tmp_path, settings, None).pack()["episodes"]) == [(0, "known"), (1, "known")]
    with np.load(tmp_path / "traces.npz") as traces:
        assert {"e0/known/states", "e1/known/states"} <= set(traces.files)
    json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)
