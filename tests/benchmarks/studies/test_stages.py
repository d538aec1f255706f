"""The stages' benchmark times what it says it times, and keeps what it has measured."""

import json
import multiprocessing
import os
import time

import numpy as np
import pytest
import torch

from benchmarks.studies.performance import __main__ as stages
from benchmarks.studies.performance import beside, peers, rates, stage_times, throughput
from benchmarks.studies.performance import sized_maps as places
from benchmarks.studies.performance.__main__ import main
from benchmarks.studies.performance.stage_times import spread, timed
from benchmarks.studies.performance.tables import measures_table, table
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
    hall = places.cluttered(200, 0).grid
    assert hall.occupied[0].all()
    assert 0.02 < hall.occupied[1:-1, 1:-1].mean() < 0.5
    assert np.array_equal(hall.cells, places.cluttered(200, 0).grid.cells)


def test_each_stage_is_told_with_its_tails_threads_and_samples():
    stage = {"median_ms": 1.0, "p95_ms": 2.0, "p99_ms": 3.0, "samples": 7}
    told = table({"known": {"scan": {**stage, "threads": 1}}})
    cells = [cell.strip() for cell in told.splitlines()[2].split("|")[1:-1]]
    assert cells == ["`known`", "scan", "1.00", "2.00", "3.00", "1", "7"]


def test_measures_are_told_with_their_intervals_and_tails():
    told = measures_table(
        {
            "a": {"value": 12.3456, "unit": "ms", "p99": 20.0, "samples": 5},
            "b": {"value": 1.0, "low": -2.0, "high": 4.0, "unit": "MiB", "samples": 6},
        }
    )
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in told.splitlines()]
    assert cells[2:] == [["a", "12.35", "20", "ms", "5"], ["b", "1 (-2 to 4)", "", "MiB", "6"]]


@pytest.fixture
def quick(monkeypatch):
    """Everything small, and no processes."""
    for name, few in (
        ("SCANS", 3),
        ("ROUNDS", 1),
        ("REPEATS", 3),
        ("VIEWS", 3),
        ("RISK_MAPS", 2),
    ):
        monkeypatch.setattr(rates, name, few)
    monkeypatch.setattr(peers, "REPEATS", 10)
    plain = stage_times.closed_loop

    def short(arm, drives, seed):
        return plain("known" if arm == "oracle" else arm, drives, seed)

    monkeypatch.setattr(stage_times, "closed_loop", short)
    short_drives = (0.1, 0.5, 0.3, 0.2, 10, None)
    monkeypatch.setattr("sim.episode.EpisodeConfig.__init__.__defaults__", short_drives)

    def driven(settings, items, jobs, report):
        return [throughput.Driven(30.0, 3.0, 900.0) for _ in items]

    monkeypatch.setattr(throughput, "driven", driven)
    times = dict.fromkeys(beside.STAGES, [5.0] * 9 + [9.0])
    monkeypatch.setattr(beside, "_on_cores", lambda drives, seed, cores: (times, 2))


def test_other_work_keeps_each_core_busy_until_the_end():
    core, before = max(os.sched_getaffinity(0)), set(multiprocessing.active_children())
    with beside._load([core]):
        (process,) = set(multiprocessing.active_children()) - before
        while os.sched_getaffinity(process.pid) != {core}:
            time.sleep(0.02)
        assert process.is_alive()
    assert not process.is_alive()


@pytest.mark.slow(20)
def test_one_command_writes_all_and_goes_on_after_an_interrupt(
    tmp_path, monkeypatch, capsys, quick
):
    command = ["--out", str(tmp_path), "--drives", "1"]
    measure = throughput.memory
    for name in stages.LIMITS:
        monkeypatch.setenv(name, "2")
    torch.set_num_threads(2)

    def interrupted(drives, seed, report):
        raise KeyboardInterrupt

    monkeypatch.setattr(throughput, "memory", interrupted)
    assert main(command) == 130
    assert "the same command goes on" in capsys.readouterr().err
    assert not (tmp_path / "results.json").exists()

    def forbidden(*_):
        raise AssertionError("measured twice")

    monkeypatch.setattr(throughput, "memory", measure)
    monkeypatch.setattr(rates, "rays", forbidden)
    assert main(command) == 0
    results = json.loads((tmp_path / "results.json").read_text())
    assert {"scan", "integrate", "crop", "predict", "risk", "mpc", "cycle", "path"} <= set(
        results["stages"]
    )
    for stage in results["stages"].values():
        assert 0 < stage["median_ms"] <= stage["p99_ms"]
        assert stage["threads"] == 1
    assert torch.get_num_threads() == 1
    assert os.environ["OMP_NUM_THREADS"] == "1"
    assert results["stages"]["cycle"]["median_ms"] > results["stages"]["predict"]["median_ms"]
    measures = results["measures"]
    assert measures["rays, on ways, corridor 1000², 1 thread"]["value"] > 0
    assert measures["prediction, in a process of its own"]["value"] > 0
    assert measures["throughput, 2 processes"]["value"] == pytest.approx(10.0)
    assert measures["1,000 episodes of 3 arms, 2 processes"]["value"] == pytest.approx(75.0)
    for cores in ("one core", "two cores", "two cores, each with other work"):
        assert measures[f"cycle on the wall clock, {cores}"]["value"] == 5.0
        assert measures[f"late controls, {cores}"]["value"] == 2.0
    assert results["peak_memory_mib"] == 900.0
    out = " ".join(capsys.readouterr().out.split())
    assert "| `predicted` | predict |" in out
    assert "| risk map 200² |" in out
    assert show([str(tmp_path / "results.json")]) == 0
    assert "| `predicted` | cycle |" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "wrong", [["--drives", "0"], ["--seed", "-1"], ["--memory", "5"], ["--episodes", "0"]]
)
def test_arguments_that_make_no_sense_are_refused(wrong, capsys):
    assert main(wrong) == 2
    assert wrong[0] in capsys.readouterr().err


def test_missing_peers_are_named_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stages, "PEER", "no_such_module")
    assert main(["--peers", "--out", str(tmp_path)]) == 2
    assert "--peers needs no_such_module" in capsys.readouterr().err


def test_peers_are_measured_anew_when_one_of_them_is_another(monkeypatch):
    monkeypatch.setattr(
        "benchmarks.studies.performance.measurements.installed",
        lambda packages: dict.fromkeys(packages, "1"),
    )
    parts = stages.measurements(stages.StageSettings(peers=True), print)
    of_peers = [part for part in parts if part.name.startswith("peers/mpc")]
    assert len(of_peers) == 2
    for part in of_peers:
        assert part.settings["packages"] == {stages.PEER_PACKAGE: "1"}


def test_a_missing_compiler_is_named_too(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stages, "PEER", "json")
    monkeypatch.setattr(stages, "COMPILER", "no-such-compiler")
    assert main(["--peers", "--out", str(tmp_path)]) == 2
    assert "--peers needs no-such-compiler" in capsys.readouterr().err
