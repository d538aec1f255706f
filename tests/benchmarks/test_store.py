"""A run on disk: each drive is there once, whenever it was packed, and whoever was interrupted."""

import io
import subprocess
import sys
import zipfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from drive_results import a_result

from benchmarks.runs.settings import Settings
from benchmarks.runs.store import Store
from benchmarks.runs.trace import Drive, Trace
from foresee.infra import part_file
from foresee.infra.command_line import UsageError
from foresee.infra.environment import several_states
from planner.revision import FIRST

TWO = Settings(episodes=2, arms=("known",))


def driven(index, arm):
    """A drive that nobody drove: its result and trace."""
    result = a_result(
        arm=arm, index=index, world=f"w{index % 5}", seed=index, path_length=20.0 + index % 7
    )
    arrays = {
        f"e{index}/{arm}/states": np.array([[index, len(arm), 0.0, 0.0]]),
        f"w{index}/cells": np.array([[index % 100]], dtype=np.int8),
        f"w{index}/frame": np.array([0.05, 0.0, 0.0]),
    }
    return Drive(result, Trace(Path("nowhere"), index, arm, arrays))


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
                run.add(driven(*key))
            results = run.pack()
    assert keys(results["episodes"]) == everything
    assert results["episodes"] == [asdict(driven(*key).result) for key in everything]
    assert results["unused"] == []
    assert results["summary"]["oracle"]["episodes"] == count
    assert not list((tmp_path / "parts").glob("*.npz"))
    with np.load(tmp_path / "traces.npz") as traces:
        assert len(traces.files) == len(set(traces.files)) == len(everything) + 2 * count
        for index, arm in everything[::37]:
            assert traces[f"e{index}/{arm}/states"].tolist() == [[index, len(arm), 0, 0]]
            assert traces[f"w{index}/cells"].tolist() == [[index % 100]]


def test_drives_that_are_not_asked_for_any_more_are_kept(tmp_path):
    with Store(tmp_path, Settings(episodes=3, arms=("known", "oracle")), None) as run:
        for index in range(3):
            for arm in ("known", "oracle"):
                run.add(driven(index, arm))
        run.pack()
    with Store(tmp_path, Settings(episodes=2, arms=("oracle",)), None) as fewer:
        assert keys(fewer.pack()["episodes"]) == [(0, "oracle"), (1, "oracle")]
    with Store(tmp_path, Settings(episodes=3, arms=("oracle", "known")), None) as again:
        assert len(again.done()) == 6
        assert keys(again.pack()["episodes"])[:2] == [(0, "oracle"), (0, "known")]


def test_drives_of_another_revision_of_the_planner_are_not_mixed_with_those_of_today(tmp_path):
    new = driven(0, "known")
    old = new._replace(result=replace(new.result, revision=FIRST))
    with Store(tmp_path / "old", TWO, None) as run:
        run.add(old)
        run.pack()
    message = f"holds drives of revision {FIRST} of the planner, and this is revision"
    with pytest.raises(UsageError, match=message):
        Store(tmp_path / "old", TWO, None)
    with pytest.raises(UsageError, match=f"--baselines .*{message}"):
        Store(tmp_path / "new", TWO, None, baselines=tmp_path / "old")


def interrupted(*_):
    raise KeyboardInterrupt


def test_a_drive_that_was_written_but_not_noted_is_there_the_next_time(tmp_path, monkeypatch):
    plain = part_file.write_whole

    def written(path, data):
        plain(path, data)
        raise KeyboardInterrupt

    with Store(tmp_path, TWO, None) as run:
        run.add(driven(0, "known"))
        with monkeypatch.context() as patched:
            patched.setattr(part_file, "write_whole", written)
            with pytest.raises(KeyboardInterrupt):
                run.add(driven(1, "known"))
        assert keys(run.pack()["episodes"]) == [(0, "known")]
    with Store(tmp_path, TWO, None) as run:
        assert keys(run.pack()["episodes"]) == [(0, "known"), (1, "known")]


def test_a_run_that_is_stopped_while_it_packs_loses_nothing(tmp_path, monkeypatch):
    files = [tmp_path / name for name in ("results.json", "traces.npz")]
    with Store(tmp_path, TWO, None) as run:
        run.add(driven(0, "known"))
        run.pack()
        run.add(driven(1, "known"))
        before = [path.read_bytes() for path in files]
        with monkeypatch.context() as patched:
            patched.setattr("os.replace", interrupted)
            with pytest.raises(KeyboardInterrupt):
                run.pack()
    assert [path.read_bytes() for path in files] == before
    with Store(tmp_path, TWO, None) as run:
        assert keys(run.pack()["episodes"]) == [(0, "known"), (1, "known")]
    with np.load(tmp_path / "traces.npz") as traces:
        assert {"e0/known/states", "e1/known/states"} <= set(traces.files)


def test_a_folder_is_of_one_run_at_a_time(tmp_path):
    with Store(tmp_path, TWO, None) as run:
        run.add(driven(0, "known"))
        with pytest.raises(UsageError, match="another run is at work"):
            Store(tmp_path, TWO, None)
        run.add(driven(1, "known"))
    with Store(tmp_path, TWO, None) as run:
        assert run.done() == {(0, "known"), (1, "known")}


HOLD = """
import sys
import zipfile
from pathlib import Path
from benchmarks.runs.settings import Settings
from benchmarks.runs.store import Store

run = Store(Path(sys.argv[1]), Settings(episodes=2, arms=("known",)), None)
print("at work", flush=True)
sys.stdin.read()
"""


def test_a_run_that_was_killed_keeps_nobody_out(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, tmp_path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "at work\n"
        with pytest.raises(UsageError, match="another run is at work"):
            Store(tmp_path, TWO, None)
        holder.kill()
    with Store(tmp_path, TWO, None) as run:
        assert run.done() == set()


def test_results_of_several_states_of_the_code_are_told():
    assert "these drives were made with 2 versions" in several_states(["a", "b", "a"], "drives")
    assert "2 versions" in several_states(["a", None], "scores")
    assert several_states(["a", "a"], "drives") == several_states([], "drives") == ""


def run_of(folder, episodes=4, pieces=2):
    """A packed run of one arm, its drives and results."""
    for piece in range(pieces):
        with Store(folder, Settings(episodes=episodes, arms=("known",)), None) as run:
            for index in range(piece, episodes, pieces):
                run.add(driven(index, "known"))
            results = run.pack()
    return results


def again(folder, episodes=4):
    """Open a run, drive what is missing, and pack: what was missing, the notes, the results."""
    with Store(folder, Settings(episodes=episodes, arms=("known",)), None) as run:
        missing = sorted({(i, "known") for i in range(episodes)} - run.done())
        for index, arm in missing:
            run.add(driven(index, arm))
        return [index for index, _ in missing], list(run.notes), run.pack()


def assert_whole(folder, results, before):
    assert results["episodes"] == before["episodes"]
    with np.load(folder / "traces.npz") as traces:
        for index in range(len(before["episodes"])):
            assert traces[f"e{index}/known/states"].tolist() == [[index, len("known"), 0, 0]]


@pytest.mark.parametrize("damage", ["truncated", "empty", "missing"])
def test_traces_that_are_lost_are_set_aside_and_their_drives_driven_again(tmp_path, damage):
    before = run_of(tmp_path)
    traces = tmp_path / "traces.npz"
    data = traces.read_bytes()
    if damage == "missing":
        traces.unlink()
    else:
        traces.write_bytes(data[: len(data) // 2] if damage == "truncated" else b"")
    damaged = None if damage == "missing" else traces.read_bytes()
    missing, notes, results = again(tmp_path)
    assert missing == [0, 1, 2, 3]
    assert any("driven again" in note for note in notes)
    assert_whole(tmp_path, results, before)
    if damaged is not None:
        assert (tmp_path / "traces.npz.damaged").read_bytes() == damaged


@pytest.mark.parametrize("kills", [0, 1, 3])
def test_of_traces_with_a_flipped_byte_what_is_whole_is_kept(tmp_path, monkeypatch, kills):
    before = run_of(tmp_path)
    traces = tmp_path / "traces.npz"
    with zipfile.ZipFile(traces) as packed:
        entry = packed.getinfo("e2/known/states.npy")
    data = bytearray(traces.read_bytes())
    data[entry.header_offset + 30 + len(entry.filename) + entry.compress_size // 2] ^= 0xFF
    traces.write_bytes(bytes(data))
    plain, written = part_file.write_whole, []

    def killed(path, data):
        written.append(path)
        if len(written) == kills:
            raise KeyboardInterrupt
        plain(path, data)

    if kills:
        with monkeypatch.context() as patched:
            patched.setattr(part_file, "write_whole", killed)
            with pytest.raises(KeyboardInterrupt):
                again(tmp_path)
    missing, notes, results = again(tmp_path)
    assert missing == [2]
    assert any("do not read" in note for note in notes)
    assert sum("driven again" in note for note in notes) == 1
    assert_whole(tmp_path, results, before)
    assert (tmp_path / "traces.npz.damaged").read_bytes() == bytes(data)


def test_without_its_settings_a_run_is_compared_with_those_of_its_results(tmp_path):
    before = run_of(tmp_path)
    (tmp_path / "settings.json").unlink()
    with pytest.raises(UsageError, match=r"holds a run with .*v_max 4"):
        Store(tmp_path, Settings(episodes=4, arms=("known",), v_max=2.0), None)
    (tmp_path / "settings.json").unlink()
    missing, notes, results = again(tmp_path)
    assert (missing, notes) == ([], [])
    assert_whole(tmp_path, results, before)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"episodes": [{}], "unused": [], "skipped": {}}', "[" * 100_000]
)
def test_results_that_are_damaged_or_of_another_version_are_set_aside(tmp_path, text):
    before = run_of(tmp_path)
    (tmp_path / "results.json").write_text(text)
    missing, notes, results = again(tmp_path)
    assert missing == [0, 1, 2, 3]
    assert any("results.json is damaged" in note for note in notes)
    assert_whole(tmp_path, results, before)
    assert (tmp_path / "results.json.damaged").read_text() == text


def test_a_loose_drive_with_a_flipped_byte_is_set_aside_and_driven_again(tmp_path):
    with Store(tmp_path, Settings(episodes=2, arms=("known",)), None) as run:
        for index in range(2):
            run.add(driven(index, "known"))
    part = tmp_path / "parts" / "1-known.npz"
    whole = part.read_bytes()
    for place in range(40, len(whole), 97):
        data = bytearray(whole)
        data[place] ^= 0xFF
        part.write_bytes(bytes(data))
        with Store(tmp_path, Settings(episodes=2, arms=("known",)), None) as run:
            # A byte that no checksum covers, such as one of a date, does no harm.
            assert run.done() == {(0, "known")} if run.notes else {(0, "known"), (1, "known")}
    part.write_bytes(whole[:-20])
    missing, notes, results = again(tmp_path, episodes=2)
    assert missing == [1]
    assert len(notes) == 1
    assert_whole(
        tmp_path, results, {"episodes": [asdict(driven(i, "known").result) for i in range(2)]}
    )


def objects():
    out = io.BytesIO()
    np.save(out, np.array([{}], dtype=object), allow_pickle=True)
    return out.getvalue()


def array(values):
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()


LIES = {
    "objects": objects(),
    "more than there is": array(np.zeros((1, 4))).replace(b"(1, 4)", b"(9, 4)"),
    "another type": array(np.zeros((1, 4))).replace(b"<f8", b"<c8"),
    "another shape": array(np.zeros(4)),
    "no numbers": array(np.full((1, 4), np.nan)),
}


@pytest.mark.parametrize("lie", LIES)
def test_traces_that_lie_are_set_aside_and_their_drives_driven_again(tmp_path, lie):
    before = run_of(tmp_path)
    traces = tmp_path / "traces.npz"
    with zipfile.ZipFile(traces) as packed:
        members = {name: packed.read(name) for name in packed.namelist()}
    members["e2/known/states.npy"] = LIES[lie]
    with zipfile.ZipFile(traces, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name, content in members.items():
            packed.writestr(name, content)
    damaged = traces.read_bytes()
    missing, notes, results = again(tmp_path)
    assert missing == [2]
    assert any("do not read" in note and "e2/known" in note for note in notes)
    assert_whole(tmp_path, results, before)
    assert (tmp_path / "traces.npz.damaged").read_bytes() == damaged


@pytest.mark.parametrize("lie", LIES)
def test_a_loose_drive_that_lies_is_set_aside_and_driven_again(tmp_path, lie):
    with Store(tmp_path, TWO, None) as run:
        for index in range(2):
            run.add(driven(index, "known"))
    part = tmp_path / "parts" / "1-known.npz"
    with zipfile.ZipFile(part) as packed:
        members = {name: packed.read(name) for name in packed.namelist()}
    members["e1/known/states.npy"] = LIES[lie]
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name, content in members.items():
            packed.writestr(name, content)
    missing, notes, _ = again(tmp_path, episodes=2)
    assert missing == [1]
    assert len(notes) == 1


def test_traces_that_unpack_to_gigabytes_are_set_aside(tmp_path):
    run_of(tmp_path)
    traces = tmp_path / "traces.npz"
    with (
        zipfile.ZipFile(traces, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as packed,
        packed.open("e2/known/plans.npy", "w") as file,
    ):
        for _ in range(257):
            file.write(bytes(2**20))
    missing, notes, _ = again(tmp_path)
    assert missing == [2]
    assert any("larger than" in note for note in notes)


def test_a_loose_drive_under_the_name_of_another_is_set_aside(tmp_path):
    with Store(tmp_path, TWO, None) as run:
        run.add(driven(0, "known"))
    (tmp_path / "parts" / "0-known.npz").rename(tmp_path / "parts" / "1-known.npz")
    missing, notes, _ = again(tmp_path, episodes=2)
    assert missing == [0, 1]
    assert "it holds episode 0 of known" in notes[0]


def test_the_lock_of_a_folder_destroys_nothing(tmp_path):
    (tmp_path / "precious").write_text("kept")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock").symlink_to(tmp_path / "precious")
    with pytest.raises(UsageError, match="cannot be used"):
        Store(tmp_path / "run", TWO, None)
    assert (tmp_path / "precious").read_text() == "kept"
