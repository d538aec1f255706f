"""Frames come back as they were written, and a set that is not whole says what is wrong."""

import json
import platform
import subprocess
import sys

import numpy as np
import pytest

from foresee.infra.command_line import UsageError
from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN
from predictor.data.frame_set import FrameSet, write_trajectory
from predictor.data.frames import (
    ARRAYS,
    MANIFEST,
    Frames,
    FramesError,
    checksum,
)
from predictor.data.squares import decode_cells, encode_cells

NAMES = ["train-000", "train-001", "test-000"]


def some_arrays(seed, count=4):
    rng = np.random.default_rng(seed)
    arrays = {
        name: rng.integers(0, 3, (count, *shape)).astype(kind)
        for name, (kind, shape) in ARRAYS.items()
    }
    arrays["corners"] = rng.integers(-150, 200, (count, 2)).astype(np.int32)
    arrays["map"] = rng.integers(0, 3, (260, 310)).astype(np.uint8)
    arrays["origin"] = np.array([1.5, -2.0])
    return arrays


def about(name):
    return {"split": name.split("-")[0], "map": f"map of {name}", "world": name, "seed": 7}


def write_set(folder, names=NAMES, settings=None):
    made = {name: some_arrays(number, 3 + number) for number, name in enumerate(NAMES)}
    frames = FrameSet(folder, "simulated", settings or {"a": 1}, NAMES)
    for name in names:
        frames.add(name, write_trajectory(folder, name, made[name], about(name)))
    return made


@pytest.fixture
def folder(tmp_path):
    write_set(tmp_path)
    return tmp_path


def edit(folder, change):
    manifest = json.loads((folder / MANIFEST).read_text())
    change(manifest)
    (folder / MANIFEST).write_text(json.dumps(manifest))


def test_frames_come_back_as_they_were_written(tmp_path):
    made = list(write_set(tmp_path).values())
    frames = Frames.load(tmp_path)
    assert len(frames) == 3 + 4 + 5
    assert np.array_equal(frames.trajectory, [0] * 3 + [1] * 4 + [2] * 5)
    for name in ("estimated", "remembered", "states", "actions", "times", "corners"):
        assert np.array_equal(getattr(frames, name), np.concatenate([a[name] for a in made]))
    assert [facts["split"] for facts in frames.about] == ["train", "train", "test"]
    assert frames.about[2]["count"] == 5
    assert frames.about[2]["seed"] == 7
    assert frames.worlds == set(NAMES)
    assert all(np.array_equal(a["map"], b) for a, b in zip(made, frames.maps, strict=True))
    assert np.array_equal(frames.origins[1], [1.5, -2.0])


def test_one_split_can_be_read_alone(folder):
    test = Frames.load(folder, "test")
    assert len(test) == 5
    assert test.worlds == {"test-000"}
    whole = Frames.load(folder)
    assert np.array_equal(test.estimated, whole.estimated[7:])
    assert np.array_equal(test.truth(slice(None), 1.5), whole.truth(slice(7, None), 1.5))


def test_the_truth_is_cut_out_of_the_map_and_unknown_beyond_it(folder):
    frames = Frames.load(folder)
    truth = frames.truth(slice(None), 2.0)
    assert truth.shape == (12, 200, 200)
    for number in range(12):
        cells = frames.maps[frames.trajectory[number]]
        for row, col in [(0, 0), (99, 50), (199, 199), (10, 180)]:
            at = frames.corners[number] + (row, col)
            inside = (at >= 0).all() and (at < cells.shape).all()
            assert truth[number, row, col] == (cells[tuple(at)] if inside else 2)


def test_smaller_expansions_are_centred_crops_of_larger_ones(folder):
    frames = Frames.load(folder)
    largest = frames.truth(5, 2.0)
    for expansion in (1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9):
        side = round(100 * expansion)
        inset = (200 - side) // 2
        truth = frames.truth(5, expansion)
        assert truth.shape == (side, side)
        assert np.array_equal(truth, largest[inset:-inset, inset:-inset])


def test_an_index_may_be_a_number_a_slice_or_an_array(folder):
    frames = Frames.load(folder)
    every = frames.truth(slice(None), 1.1)
    assert np.array_equal(frames.truth(-1, 1.1), every[-1])
    assert np.array_equal(frames.truth(np.array([3, 1]), 1.1), every[[3, 1]])
    assert np.array_equal(frames.truth(np.arange(12) > 6, 1.1), every[7:])


@pytest.mark.parametrize("expansion", [0.9, 1.01, 1.11, 2.02, 1.105, -1.0])
def test_an_expansion_without_a_middle_or_out_of_range_is_refused(folder, expansion):
    with pytest.raises(FramesError, match=r"must be 1\.00"):
        Frames.load(folder).truth(0, expansion)


def test_codes_and_cells_are_each_others_reverse():
    cells = np.array([[FREE, OCCUPIED, UNKNOWN]], np.int8)
    assert encode_cells(cells).tolist() == [[0, 1, 2]]
    assert np.array_equal(decode_cells(encode_cells(cells)), cells)


def test_an_empty_folder_says_how_to_fill_it(tmp_path):
    with pytest.raises(FramesError, match=r"predictor\.dataset"):
        Frames.load(tmp_path / "nothing")


def test_an_unknown_split_is_told_which_there_are(folder):
    with pytest.raises(FramesError, match="it has test, train"):
        Frames.load(folder, "holdout")


def test_a_missing_shard_is_named(folder):
    (folder / "train-001.npz").unlink()
    with pytest.raises(FramesError, match=r"train-001\.npz is missing"):
        Frames.load(folder)
    assert len(Frames.load(folder, "test")) == 5


@pytest.mark.parametrize("cut", [1, 200, 5000])
def test_a_damaged_shard_is_named(folder, cut):
    path = folder / "train-001.npz"
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(FramesError, match=r"train-001\.npz is damaged.*checksum"):
        Frames.load(folder)


def test_a_shard_of_other_shapes_is_refused_though_its_checksum_fits(folder):
    arrays = some_arrays(1, 4)
    for name, wrong in [
        ("estimated", arrays["estimated"][:, :50]),
        ("remembered", arrays["remembered"].astype(np.int64)),
        ("states", arrays["states"][:3]),
        ("map", arrays["map"].ravel()),
        ("corners", arrays["corners"] + 1000),
        ("states", np.full((4, 4), np.nan)),
    ]:
        facts = write_trajectory(folder, "train-001", arrays | {name: wrong}, about("train-001"))
        facts["count"] = 4
        edit(folder, lambda manifest, facts=facts: manifest["trajectories"].__setitem__(1, facts))
        with pytest.raises(FramesError, match=r"train-001\.npz is damaged"):
            Frames.load(folder)


def test_a_file_whose_name_is_too_long_is_missing(folder):
    facts = {"file": 300 * "x", "count": 4, "sha256": "0"}
    edit(folder, lambda manifest: manifest["trajectories"][1].update(facts))
    with pytest.raises(FramesError, match="is missing"):
        Frames.load(folder)


def test_images_with_other_codes_are_refused(folder):
    arrays = some_arrays(1, 4)
    arrays["estimated"][2, 5, 5] = 3
    facts = write_trajectory(folder, "train-001", arrays, about("train-001"))
    edit(folder, lambda manifest: manifest["trajectories"].__setitem__(1, facts))
    frames = Frames.load(folder)
    assert frames.remembered.shape == (12, 200, 200)
    with pytest.raises(FramesError, match="estimated holds codes other than 0, 1, 2"):
        _ = frames.estimated


def test_a_file_with_arrays_missing_is_refused(folder):
    path = folder / "train-001.npz"
    np.savez(path, something=np.zeros(3))
    edit(folder, lambda m: m["trajectories"][1].__setitem__("sha256", checksum(path)))
    with pytest.raises(FramesError, match="damaged"):
        Frames.load(folder)


def test_pickled_arrays_are_not_read(folder):
    path = folder / "train-001.npz"
    np.savez(path, **(some_arrays(1, 4) | {"map": np.array([[{"run": "me"}]], dtype=object)}))
    edit(folder, lambda m: m["trajectories"][1].__setitem__("sha256", checksum(path)))
    with pytest.raises(FramesError, match="damaged"):
        Frames.load(folder)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda m: m.update(format=99), "of format 99, this version reads 1"),
        (lambda m: m.pop("format"), "no manifest of a data set"),
        (lambda m: m.pop("trajectories"), "'planned' or 'trajectories' is missing"),
        (lambda m: m["trajectories"][0].pop("sha256"), "trajectory 0 has no proper 'sha256'"),
        (lambda m: m["trajectories"][0].update(file="../../secret.npz"), "odd file"),
        (lambda m: m["trajectories"].pop(), "unfinished, it has 2 of 3"),
    ],
)
def test_a_manifest_that_is_foreign_or_broken_says_how(folder, change, says):
    edit(folder, change)
    with pytest.raises(FramesError, match=says):
        Frames.load(folder)


def test_a_manifest_that_is_no_json_is_an_error(folder):
    (folder / MANIFEST).write_text("{half of")
    with pytest.raises(FramesError, match="cannot be read"):
        Frames.load(folder)


def test_a_set_goes_on_where_it_was(tmp_path):
    write_set(tmp_path, NAMES[:2])
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()
    half = tmp_path / f".test-000.npz.{gone}@{platform.node()}.tmp"
    half.write_bytes(b"half")
    (tmp_path / f"thesis.{gone}.tmp").write_bytes(b"no temporary file of this project")
    again = FrameSet(tmp_path, "simulated", {"a": 1}, NAMES)
    assert again.missing == ["test-000"]
    assert [path.name for path in tmp_path.glob("*.tmp")] == [f"thesis.{gone}.tmp"]
    with pytest.raises(FramesError, match="unfinished"):
        Frames.load(tmp_path)


def test_a_damaged_trajectory_is_made_again(folder):
    path = folder / "train-000.npz"
    path.write_bytes(path.read_bytes()[:-1])
    assert FrameSet(folder, "simulated", {"a": 1}, NAMES).missing == ["train-000"]


def test_another_set_in_the_folder_is_not_overwritten(folder):
    before = (folder / MANIFEST).read_bytes()
    with pytest.raises(UsageError, match="with a 1; choose another"):
        FrameSet(folder, "simulated", {"a": 2}, NAMES)
    with pytest.raises(UsageError, match="with kind simulated; choose another"):
        FrameSet(folder, "physical", {"a": 1}, NAMES)
    assert (folder / MANIFEST).read_bytes() == before


def test_the_same_frames_give_the_same_bytes(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        write_trajectory(tmp_path / name, "x", some_arrays(0), about("x-0"))
    assert checksum(tmp_path / "a" / "x.npz") == checksum(tmp_path / "b" / "x.npz")
