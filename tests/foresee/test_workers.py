"""Work is done once and comes out the same, whoever does it and whoever dies."""

import importlib
import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from functools import partial
from pathlib import Path

import pytest

from foresee.infra import workers
from foresee.infra.workers import LostError, WorkersError, check_scheduler, finished


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


def die_of(bad, n):
    if n in bad:
        die(n)
    return n * n


def all_but_lost(work, todo, jobs, dask=None):
    """What was finished, sorted, and what was lost."""
    done = []
    with pytest.raises(LostError) as error:
        done.extend(finished(work, todo, jobs, dask))
    return sorted(done), sorted(error.value.items)


@pytest.fixture
def distributed():
    """Not imported above: each process of a pool would import it, too."""
    return pytest.importorskip("distributed")


@pytest.fixture
def cluster(distributed, tmp_path):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path / "dask"
    ) as made:
        yield made


MASKED = """\
import multiprocessing, signal
from foresee.infra.workers import finished, interrupts_blocked

def masked(_=None):
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])

def say():
    print(masked(), flush=True)

if __name__ == "__main__":
    with interrupts_blocked():
        process = multiprocessing.get_context("spawn").Process(target=say)
        process.start()
    process.join()
    print(masked(), *(blocked for _, blocked in finished(masked, [0, 1, 2], 2)))
"""


def test_ctrl_c_does_not_reach_the_first_instant_of_a_process(tmp_path):
    # In a process of its own, in which no tracker of resources runs yet.
    script = tmp_path / "masked.py"
    script.write_text(MASKED)
    root = str(Path(workers.__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, script],
        env=os.environ | {"PYTHONPATH": root},
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["True", "False", "True", "True", "True"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_everything_is_done_once(jobs):
    assert sorted(finished(square, list(range(20)), jobs)) == [(n, n * n) for n in range(20)]


def test_a_process_that_dies_costs_nothing(tmp_path):
    done = list(finished(partial(die_once, tmp_path), list(range(8)), 2))
    assert sorted(done) == [(n, n * n) for n in range(8)]
    assert (tmp_path / "died").exists()


def test_what_kills_each_process_is_named_when_all_else_is_done():
    bad = (0, 9)
    done, lost = all_but_lost(partial(die_of, bad), list(range(12)), 2)
    assert done == [(n, n * n) for n in range(12) if n not in bad]
    assert lost == list(bad)
    assert "again and again: 0, 9" in str(LostError(lost))


def test_where_all_die_not_everything_is_tried(monkeypatch):
    monkeypatch.setattr(workers, "DEATHS", 2)
    assert all_but_lost(die, list(range(1000)), 2) == ([], list(range(1000)))


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


@pytest.mark.slow
def test_what_kills_each_dask_worker_is_named_when_all_else_is_done(cluster):
    cluster.scheduler.allowed_failures = 1
    address = cluster.scheduler_address
    done, lost = all_but_lost(partial(die_of, (3,)), list(range(20)), 1, address)
    # Those beside it may be taken for it.
    assert 3 in lost
    assert sorted([*lost, *(n for n, _ in done)]) == list(range(20))


class Absent:
    """What can be sent, and not be received where its package is missing."""

    def __reduce__(self):
        return importlib.import_module, ("no_such_package",)


def test_a_scheduler_without_the_package_is_named(cluster):
    with pytest.raises(WorkersError, match="lacks packages: No module named 'no_such_package'"):
        list(finished(partial(square, Absent()), [1], 1, cluster.scheduler_address))


def test_a_scheduler_that_is_not_there_is_named(distributed, monkeypatch):
    patient = distributed.Client
    monkeypatch.setattr(
        distributed, "Client", lambda *words, **rest: patient(*words, **rest | {"timeout": 0.5})
    )
    with pytest.raises(WorkersError, match="no Dask scheduler answers at tcp"):
        list(finished(square, [1], 1, "tcp://127.0.0.1:9"))


@pytest.mark.parametrize(
    "address",
    [
        "",
        "foo",
        "127.0.0.1",
        "tcp://",
        "tcp://a:b",
        "tcp://a:1:2",
        "http://a:1",
        "a:99999",
        "a:1/x",
    ],
)
def test_an_address_that_is_none_is_refused_at_once(address):
    with pytest.raises(WorkersError, match=r"is no address of a Dask scheduler, such as tcp://"):
        check_scheduler(address)


@pytest.mark.parametrize("address", ["a:1", "tcp://10.0.0.1:8786", "tls://[::1]:8786"])
def test_an_address_may_lack_the_protocol(address):
    check_scheduler(address)


def test_a_server_that_is_no_scheduler_is_named(distributed, monkeypatch):
    monkeypatch.setattr(workers, "PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(WorkersError, match=r"no Dask scheduler answers.* its dashboard"):
            list(finished(square, [1], 1, address))


def test_workers_that_share_a_process_are_refused(distributed, tmp_path):
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, dashboard_address=None, local_directory=tmp_path
        ) as made,
        pytest.raises(WorkersError, match="--nthreads 1"),
    ):
        list(finished(square, [1], 1, made.scheduler_address))


WORKS = """
import sys, time
sys.path.insert(0, sys.argv[1])
from foresee.infra.workers import finished
for _ in finished(time.sleep, [0.2] * 200, 2):
    print("done", flush=True)
"""


def marked(mark):
    """The processes that have a mark in their environment."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark.encode() in path.read_bytes():
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize("after", [0.4, 0.8, 1.6, None])
def test_no_worker_outlives_a_parent_that_is_killed(after):
    mark = f"FORESEE_TEST={uuid.uuid4()}"
    name, _, value = mark.partition("=")
    root = str(Path(workers.__file__).resolve().parents[2])
    parent = subprocess.Popen(
        [sys.executable, "-c", WORKS, root], stdout=subprocess.PIPE, env=os.environ | {name: value}
    )
    if after is None:
        assert parent.stdout.readline() == b"done\n"
    else:
        time.sleep(after)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    until = time.monotonic() + 30.0
    while marked(mark) and time.monotonic() < until:
        time.sleep(0.2)
    left = marked(mark)
    for process in left:
        os.kill(process, signal.SIGKILL)
    assert not left
