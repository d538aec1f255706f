"""Work is done once and comes out the same, whoever does it and whoever dies."""

import os
import signal
import time
from functools import partial

import pytest

from benchmarks.workers import WorkersError, finished

distributed = pytest.importorskip("distributed")


def square(n):
    return n * n


def record(folder, n):
    """Leave a trace of having been worked on, and take a moment."""
    with open(folder / f"{n}.txt", "a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(0.1)
    return n * n


def die_once(folder, n):
    mark = folder / "died"
    if n == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def die(n):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture
def cluster(tmp_path):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path / "dask"
    ) as made:
        yield made


@pytest.mark.parametrize("jobs", [1, 2])
def test_everything_is_done_once(jobs):
    assert sorted(finished(square, list(range(20)), jobs)) == [(n, n * n) for n in range(20)]


def test_a_process_that_dies_costs_nothing(tmp_path):
    done = list(finished(partial(die_once, tmp_path), list(range(8)), 2))
    assert sorted(done) == [(n, n * n) for n in range(8)]
    assert (tmp_path / "died").exists()


def test_processes_that_keep_dying_are_given_up():
    with pytest.raises(WorkersError, match="again and again"):
        list(finished(die, [1, 2], 2))


@pytest.mark.slow
def test_a_dask_worker_that_is_killed_costs_nothing(cluster, tmp_path):
    folder = tmp_path / "seen"
    folder.mkdir()
    done = []
    for item, result in finished(
        partial(record, folder), list(range(40)), 1, cluster.scheduler_address
    ):
        done.append((item, result))
        if len(done) == 10:
            os.kill(int((folder / f"{item}.txt").read_text().split()[-1]), signal.SIGKILL)
    assert sorted(done) == [(n, n * n) for n in range(40)]


def test_a_scheduler_that_is_not_there_is_named():
    with pytest.raises(WorkersError, match="no Dask scheduler answers at tcp"):
        list(finished(square, [1], 1, "tcp://127.0.0.1:9"))


def test_workers_that_share_a_process_are_refused(tmp_path):
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None,
                                 local_directory=tmp_path) as made,
        pytest.raises(WorkersError, match="--nthreads 1"),
    ):  # fmt: skip
        list(finished(square, [1], 1, made.scheduler_address))
