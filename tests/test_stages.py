"""The stages' benchmark times what it says it times."""

import json
import time

import numpy as np
import pytest

from benchmarks import stages
from benchmarks.stages import main, spread, timed
from benchmarks.tables import main as show


def test_spread_is_of_the_times():
    s = spread([1.0] * 98 + [5.0, 9.0])
    assert s["median_ms"] == 1.0
    assert s["samples"] == 100
    assert s["median_ms"] <= s["p95_ms"] <= s["p99_ms"] <= 9.0


def test_timed_calls_once_more_than_it_counts(monkeypatch):
    called, now = [], [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])

    def call(i):
        called.append(i)
        now[0] += 9.0 if len(called) == 1 else 0.003

    taken = timed(call, 5)
    assert called == [0, 0, 1, 2, 3, 4]
    assert taken["samples"] == 5
    assert taken["median_ms"] == taken["p99_ms"] == pytest.approx(3.0)


def test_a_hall_has_walls_and_things():
    hall = stages._cluttered(200, 0).grid
    assert hall.occupied[0].all()
    assert 0.02 < hall.occupied[1:-1, 1:-1].mean() < 0.5
    assert np.array_equal(hall.cells, stages._cluttered(200, 0).grid.cells)


@pytest.mark.slow
def test_one_command_writes_stages_and_their_growth(tmp_path, monkeypatch, capsys):
    for name, few in (("BEAMS", (90, 180)), ("MAP_SIDES", (100, 200)), ("WINDOWS", (5.0,)),
                      ("EXPANSIONS", (1.0, 2.0)), ("HORIZONS", (20,)), ("REPEATS", 2)):  # fmt: skip
        monkeypatch.setattr(stages, name, few)
    plain = stages.closed_loop

    def short(arm, drives, seed, v_max=4.0):
        return plain("known" if arm == "oracle" else arm, drives, seed, v_max)

    monkeypatch.setattr(stages, "closed_loop", short)
    monkeypatch.setattr("sim.episode.EpisodeConfig.__init__.__defaults__", (0.1, 0.5, 0.3, 0.2, 10))
    assert main(["--out", str(tmp_path), "--drives", "1"]) == 0
    results = json.loads((tmp_path / "results.json").read_text())
    assert {"scan", "integrate", "crop", "predict", "risk", "mpc", "cycle", "path"} <= set(
        results["stages"]
    )
    for stage in results["stages"].values():
        assert 0 < stage["median_ms"] <= stage["p99_ms"]
    assert results["stages"]["cycle"]["median_ms"] > results["stages"]["predict"]["median_ms"]
    assert [entry["value"] for entry in results["growth"]["beams"]] == [90, 180]
    assert (tmp_path / "growth.png").stat().st_size > 5000
    assert "| `predicted` | predict |" in capsys.readouterr().out
    assert show([str(tmp_path / "results.json")]) == 0
    assert "| `predicted` | cycle |" in capsys.readouterr().out


@pytest.mark.parametrize("wrong", [["--drives", "0"], ["--seed", "-1"]])
def test_arguments_that_make_no_sense_are_refused(wrong, capsys):
    assert main(wrong) == 2
    assert wrong[0] in capsys.readouterr().err


def test_missing_peers_are_named_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stages, "PEERS", ("json", "no_such_module"))
    assert main(["--peers", "--out", str(tmp_path)]) == 2
    assert "--peers needs no_such_module" in capsys.readouterr().err
