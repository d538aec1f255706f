"""What a study costs is measured in processes that do nothing else."""

import mmap
import subprocess
import sys
import time

import pytest

from benchmarks.runs.settings import Settings
from benchmarks.studies.performance import throughput
from benchmarks.studies.performance.throughput import Driven, driven, memory, peak
from foresee.infra.workers import WorkersError


def test_throughput_is_simulated_time_over_the_time_that_the_drives_took(monkeypatch):
    asked = []

    def fake(settings, items, jobs, report):
        asked.append((items, jobs))
        return [Driven(30.0, 2.0 if arm == "known" else 5.0, 1.0) for _, arm in items]

    monkeypatch.setattr(throughput, "driven", fake)
    found = throughput.throughput(2, 0, 2, lambda _: None)
    assert asked == [([(i, arm) for i in (0, 1) for arm in Settings().arms], 2)]
    assert found["throughput, 2 processes"]["value"] == pytest.approx(90 / 12)
    assert found["1,000 episodes of 3 arms, 2 processes"]["value"] == pytest.approx(100.0)


def test_the_peak_of_memory_is_the_largest_of_all_drives(monkeypatch):
    def fake(settings, items, jobs, report):
        assert jobs == 1
        return [Driven(1.0, 1.0, 100.0 + i % 7) for i in range(len(items))]

    monkeypatch.setattr(throughput, "driven", fake)
    assert memory(12, 0, lambda _: None)["worker, peak memory"] == {
        "value": 106.0,
        "unit": "MiB",
        "samples": 12,
    }


@pytest.mark.slow(6)
def test_the_peak_of_a_process_is_its_own_and_grows_with_what_it_takes():
    module = "benchmarks.studies.performance.throughput"
    command = f"from {module} import peak; print(peak()); x = b'1' * (200 << 20); print(peak())"
    with mmap.mmap(-1, 400 * 2**20) as taken:
        taken.write(bytes(len(taken)))
        printed = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, check=True
        ).stdout
        before, after = map(float, printed.split())
        assert 0 < before < peak() - 200
        assert 150 < after - before < 300


def test_a_process_that_dies_is_told_of_in_one_line():
    # A process that cannot begin is as dead as one that crashed.
    with pytest.raises(WorkersError, match="died"):
        driven(None, [(0, "known")], 1, lambda _: None)


@pytest.mark.slow(10)
def test_drives_are_done_in_processes_of_their_own():
    reports = []
    started = time.perf_counter()
    done = driven(Settings(arms=("known",)), [(36, "known")], 1, reports.append)
    assert len(done) == len(reports) == 1
    assert sum(d.wall for d in done) < time.perf_counter() - started
    for drive in done:
        assert drive.simulated > 5.0
        assert 100 < drive.peak < 4000
