"""What a study costs is measured in processes that do nothing else."""

import mmap
import subprocess
import sys
import time

import pytest

from benchmarks.runs.settings import Settings
from benchmarks.studies.performance import throughput
from benchmarks.studies.performance.throughput import Driven, driven, memory, resident
from foresee.infra.workers import WorkersError


def test_throughput_is_simulated_time_over_the_time_that_the_drives_took(monkeypatch):
    asked = []

    def fake(settings, items, jobs, report):
        asked.append((items, jobs))
        return [Driven(30.0, 2.0 if arm == "known" else 5.0, 1.0, 1.0) for _, arm in items]

    monkeypatch.setattr(throughput, "driven", fake)
    found = throughput.throughput(2, 0, 2, lambda _: None)
    assert asked == [([(i, arm) for i in (0, 1) for arm in Settings().arms], 2)]
    assert found["throughput, 2 processes"]["value"] == pytest.approx(90 / 12)
    assert found["1,000 episodes of 3 arms, 2 processes"]["value"] == pytest.approx(100.0)


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_growth_of_memory_is_that_of_the_later_drives(monkeypatch, slope):
    def fake(settings, items, jobs, report):
        assert jobs == 1
        first = [100.0 * i for i in range(10)]
        late = [1000.0 + slope * i + (-1) ** i for i in range(30)]
        return [Driven(1.0, 1.0, m, m + 5.0) for m in first + late][: len(items)]

    monkeypatch.setattr(throughput, "driven", fake)
    found = memory(40, 0, lambda _: None)
    growth = found["worker, growth of memory"]
    assert growth["low"] < 1000 * slope < growth["high"]
    assert growth["samples"] == 20
    assert found["worker, peak memory"]["value"] == pytest.approx(1005.0 + 29 * slope, abs=2.0)
    assert len(found["worker, peak memory"]["after_each_drive"]) == 40


def test_memory_that_is_taken_is_seen():
    before = resident()
    # New pages: a list or an array may be given memory that the process has had all along.
    with mmap.mmap(-1, 64 * 2**20) as taken:
        for page in range(0, len(taken), mmap.PAGESIZE):
            taken[page] = 1
        assert 40 < resident() - before < 120


@pytest.mark.slow(6)
def test_the_peak_of_a_process_is_not_that_of_the_one_that_started_it():
    module = "benchmarks.studies.performance.throughput"
    command = f"from {module} import _peak, resident; print(_peak(), resident())"
    with mmap.mmap(-1, 400 * 2**20) as taken:
        taken.write(bytes(len(taken)))
        told = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, check=True
        ).stdout
        peak, now = map(float, told.split())
        assert now <= peak + 1 < resident() - 200


def test_a_process_that_dies_is_told_of_in_one_line():
    # A process that cannot begin is as dead as one that crashed.
    with pytest.raises(WorkersError, match="died"):
        driven(None, [(0, "known")], 1, lambda _: None)


@pytest.mark.slow(10)
def test_drives_are_done_in_processes_of_their_own():
    told = []
    started = time.perf_counter()
    done = driven(Settings(arms=("known",)), [(1, "known")], 1, told.append)
    assert len(done) == len(told) == 1
    assert sum(d.wall for d in done) < time.perf_counter() - started
    for drive in done:
        assert drive.simulated > 5.0
        assert 100 < drive.memory <= drive.peak + 1 < 4000
