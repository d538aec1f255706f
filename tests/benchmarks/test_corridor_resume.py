"""An interrupted or broken comparison goes on where it was, with the same numbers."""

import errno
import os
import signal

import pytest
from comparison import assert_same_drives, results, run
from drive_results import a_result

from benchmarks.runs.drive import attempt_arm
from benchmarks.runs.store import Store
from benchmarks.runs.trace import Drive, Trace
from foresee.infra import part_file
from foresee.infra.workers import LostError
from predictor.registry import PredictorError
from sim.map_server import MapError


def test_a_full_disk_gives_one_line_and_what_was_done_is_kept(
    short_map, tmp_path, monkeypatch, capsys
):
    command = (
        "--world",
        short_map,
        "--episodes",
        2,
        "--jobs",
        1,
        "--predictor",
        "none",
        "--arms",
        "known",
        "--out",
        tmp_path / "run",
    )
    plain, written = part_file.write_whole, []

    def full(path, data):
        if written.count(".npz") == 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(path.suffix)
        plain(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(part_file, "write_whole", full)
        assert run(*command) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert "No space left on device; what was finished is kept" in said
    assert [path.name for path in (tmp_path / "run" / "parts").glob("*.npz")] == ["0-known.npz"]
    assert run(*command) == 0
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0, 1]


def test_the_same_command_again_drives_nothing_more(narrow, monkeypatch):
    out, command = narrow
    before = results(out)["episodes"]

    def refuse(*_, **__):
        pytest.fail("it drove again")

    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", refuse)
    assert run(*command) == 0
    assert results(out)["episodes"] == before


def test_an_interrupted_run_goes_on_from_where_it_was(short_map, tmp_path, monkeypatch, capsys):
    common = ("--world", short_map, "--arms", "known", "--episodes", 2, "--jobs", 1)
    command = (*common, "--out", tmp_path / "run")
    plain, driven = attempt_arm, []

    def interrupted(settings, weights, item, **_):
        if item[0] == 1:
            raise KeyboardInterrupt
        return plain(settings, weights, item)

    def counted(settings, weights, item, **_):
        driven.append(item[0])
        return plain(settings, weights, item)

    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", interrupted)
    assert run(*command) != 0
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0]
    assert "interrupted" in capsys.readouterr().out
    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", counted)
    assert run(*command) == 0
    assert driven == [1]
    assert [e["index"] for e in results(tmp_path / "run")["episodes"]] == [0, 1]
    assert run(*common, "--out", tmp_path / "whole") == 0
    assert_same_drives(tmp_path / "run", tmp_path / "whole")


def test_a_drive_that_kills_who_drives_it_stops_no_other(short_map, tmp_path, monkeypatch, capsys):
    command = (
        "--world",
        short_map,
        "--arms",
        "known",
        "--episodes",
        2,
        "--jobs",
        1,
        "--out",
        tmp_path / "run",
    )

    def deadly(work, todo, *_):
        yield todo[0], work(todo[0])
        raise LostError(todo[1:])

    with monkeypatch.context() as patched:
        patched.setattr("benchmarks.corridor.finished", deadly)
        assert run(*command) == 1
    assert "again and again: (1, 'known')" in capsys.readouterr().err
    r = results(tmp_path / "run")
    assert (r["lost"], r["summary"]["known"]["episodes"]) == ([[1, "known"]], 1)
    assert run(*command) == 0
    r = results(tmp_path / "run")
    assert (r["lost"], r["summary"]["known"]["episodes"]) == ([], 2)


@pytest.mark.parametrize("error", [PredictorError, MapError])
def test_what_a_worker_cannot_load_is_a_line_and_loses_nothing(
    error, short_map, tmp_path, monkeypatch, capsys
):
    command = (
        "--world",
        short_map,
        "--arms",
        "known",
        "--episodes",
        2,
        "--jobs",
        1,
        "--out",
        tmp_path / "run",
    )

    def failing(settings, weights, item, **_):
        if item[0] == 1:
            raise error("it has gone")
        return Drive(a_result(), Trace(tmp_path, 0, "known", {}))

    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", failing)
    assert run(*command) == 2
    said = capsys.readouterr().err
    assert said.splitlines()[-1] == "benchmarks.corridor: it has gone; what was finished is kept"
    assert "Traceback" not in said
    assert (tmp_path / "run/parts/0-known.npz").exists()


def test_a_second_interrupt_while_packing_is_a_line(short_map, tmp_path, monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.runs.drive.attempt_arm", interrupted)
    monkeypatch.setattr("benchmarks.runs.store.Store.pack", interrupted)
    assert run("--world", short_map, "--jobs", 1, "--out", tmp_path / "run") == 130
    assert capsys.readouterr().err.splitlines()[-1].startswith("benchmarks.corridor: interrupted")


@pytest.mark.slow(40)
def test_one_job_two_and_a_cluster_with_a_death_give_the_same_numbers(
    short_map, tmp_path, monkeypatch
):
    distributed = pytest.importorskip("distributed")
    command = (
        "--world",
        short_map,
        "--episodes",
        2,
        "--arms",
        "known,backup",
        "--predictor",
        "none",
    )
    for jobs in (1, 2):
        assert run(*command, "--jobs", jobs, "--out", tmp_path / str(jobs)) == 0
    plain, killed = Store.add, []

    def add(store, drive):
        plain(store, drive)
        if not killed:
            busy = next(w.name for w in cluster.scheduler.workers.values() if w.processing)
            killed.append(cluster.workers[busy].pid)
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(Store, "add", add)
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address=None,
        local_directory=tmp_path / "workers",
    ) as cluster:
        address = cluster.scheduler_address
        assert run(*command, "--dask", address, "--out", tmp_path / "dask") == 0
    assert killed
    assert [e["arm"] for e in results(tmp_path / "1")["episodes"]] == 2 * ["known", "backup"]
    for other in ("2", "dask"):
        assert_same_drives(tmp_path / other, tmp_path / "1")
